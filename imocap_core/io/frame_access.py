"""Any frame of a video by its number: one pass notes the time stamps, later ones seek by them."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from imocap_core.io.display import ShownFrame
from imocap_core.io.video import decoded_frames, open_video, video_stream

NEAR = 48  # frames ahead that are decoded one by one rather than sought


@dataclass(frozen=True)
class DecodedFrame:
    """Frame `number` of a video; `stamp`: its presentation time in the stream's own units."""

    number: int
    stamp: int | None
    is_key: bool
    frame: ShownFrame

    def rgb(self, side_px: int) -> UInt8[np.ndarray, "height width 3"]:
        """The picture as shown, reduced so that its larger side is at most `side_px`."""
        return self._picture("rgb24", side_px)

    def gray(self, side_px: int) -> UInt8[np.ndarray, "height width"]:
        """The same, grey."""
        return self._picture("gray", side_px)

    def _picture(self, format: str, side_px: int) -> UInt8[np.ndarray, "..."]:
        return self.frame.small(format, min(1.0, side_px / max(self.frame.display.size)))


def all_frames(path: Path) -> Iterator[DecodedFrame]:
    """Every frame of a video, in the order in which they are shown. ValueError when it cannot be
    read."""
    with open_video(path) as container:
        stream = video_stream(container, path)
        for number, shown in enumerate(decoded_frames(container, stream, path)):
            yield _numbered(number, shown)


def _numbered(number: int, shown: ShownFrame) -> DecodedFrame:
    return DecodedFrame(number, shown.frame.pts, bool(shown.frame.key_frame), shown)


@dataclass(frozen=True)
class FrameStamps:
    """Time stamps of all frames of a video, and the numbers of its key frames."""

    stamps: Sequence[int | None]
    key_frames: Sequence[int]

    @cached_property
    def numbers(self) -> dict[int, int] | None:
        """Stamp -> number; None, and nothing can be sought, where some are missing or repeated."""
        numbers = {stamp: n for n, stamp in enumerate(self.stamps) if stamp is not None}
        return numbers if len(numbers) == len(self.stamps) else None

    def key_before(self, number: int) -> int:
        """The last key frame that is not after a frame; 0 when there is none."""
        place = bisect_right(self.key_frames, number)
        return self.key_frames[place - 1] if place else 0


class FrameReader:
    """An open video from which frames are taken by number; not for several threads at once."""

    def __init__(self, path: Path, stamps: FrameStamps) -> None:
        self._path, self._stamps = path, stamps
        self._container: Any = None
        self._frames: Iterator[DecodedFrame] = iter(())
        self._next = 0

    def frames(self, first: int, last: int) -> Iterator[DecodedFrame]:
        """Frames first to last. ValueError when they cannot be read."""
        if self._container is None or not self._next <= first <= self._next + NEAR:
            self._seek(first)
        for decoded in self._frames:
            self._next = decoded.number + 1
            if decoded.number >= first:
                yield decoded
            if decoded.number >= last:
                return
        self.close()

    def close(self) -> None:
        """Close the file; the next frame opens it again."""
        if self._container is not None:
            self._frames = iter(())
            self._container.close()
            self._container = None

    def _seek(self, number: int) -> None:
        """Continue with a frame at or before `number`."""
        self.close()
        key = self._stamps.key_before(number)
        if key and self._stamps.numbers is not None and self._begin_at(key, number):
            return
        self._open(None)

    def _begin_at(self, key: int, number: int) -> bool:
        """Whether decoding from a key frame's time stamp begins at or before `number`."""
        self._open(key)
        first = next(self._frames, None)
        if first is None or first.number > number:
            self.close()
            return False
        rest = self._frames
        self._frames = (frame for frames in ((first,), rest) for frame in frames)
        self._next = first.number
        return True

    def _open(self, key: int | None) -> None:
        self._container = open_video(self._path)
        stream = video_stream(self._container, self._path)
        if key is not None:
            self._container.seek(self._stamps.stamps[key], stream=stream)
        frames = decoded_frames(self._container, stream, self._path)
        numbers = self._stamps.numbers
        counted: Iterable[tuple[int, ShownFrame]] = enumerate(frames)
        if key is not None and numbers is not None:
            counted = ((numbers[f.frame.pts], f) for f in frames if f.frame.pts in numbers)
        self._frames = (_numbered(number, shown) for number, shown in counted)
        self._next = 0
