"""JPEG pictures of any frame of a video, the last ones kept in memory."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path
from threading import Lock

from imocap_core.io.frame_access import FrameReader
from imocap_core.pick.strips import LARGE_PX, THUMB_PX, Strip, jpeg

BEHIND = 10  # frames before one that is stepped back to, which are prepared too
MOST_BYTES = 24 * 2**20

SIDES_PX = {"thumb": THUMB_PX, "large": LARGE_PX}


class Pictures:
    """The pictures of one file, for several threads."""

    def __init__(self, path: Path, strip: Strip) -> None:
        self._strip = strip
        self._reader = FrameReader(path, strip.stamps)
        self._memory: OrderedDict[tuple[str, int], bytes] = OrderedDict()
        self._bytes, self._last = 0, 0
        self._lock = Lock()

    def get(self, kind: str, number: int) -> bytes | None:
        """A frame as JPEG, `kind` thumb or large; None where the video has no such frame.

        ValueError when it cannot be read.
        """
        if not 0 <= number < self._strip.count:
            return None
        if kind == "thumb" and number in self._strip.thumbs:
            return self._strip.thumbs[number]
        with self._lock:
            if (kind, number) not in self._memory:
                self._decode(kind, number)
            self._last = number
            picture = self._memory.get((kind, number))
            if picture is not None:
                self._memory.move_to_end((kind, number))
            return picture

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._reader.close()

    def _decode(self, kind: str, number: int) -> None:
        stepped_back = number < self._last <= number + BEHIND
        first = max(0, number - BEHIND) if stepped_back else number
        for decoded in self._reader.frames(first, number):
            self._put((kind, decoded.number), jpeg(decoded.rgb(SIDES_PX[kind])))

    def _put(self, key: tuple[str, int], picture: bytes) -> None:
        self._bytes += len(picture) - len(self._memory.pop(key, b""))
        self._memory[key] = picture
        while self._bytes > MOST_BYTES and len(self._memory) > 1:
            _, oldest = self._memory.popitem(last=False)
            self._bytes -= len(oldest)
