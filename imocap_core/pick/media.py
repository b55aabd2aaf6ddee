"""The video files of an action by number, each looked through once in the background."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from imocap_core.pick.background import BackgroundThread
from imocap_core.pick.pictures import Pictures
from imocap_core.pick.strips import Strip, strip_of

MOST_OPEN = 4


@dataclass
class MediaFile:
    """One file: `share` of it looked through, then its strip and pictures, or a fault."""

    path: Path
    share: float = 0.0
    strip: Strip | None = None
    pictures: Pictures | None = None
    fault: str | None = None

    def document(self) -> dict[str, Any]:
        """What the page is told of it."""
        entry: dict[str, Any] = {"name": self.path.name, "share": round(self.share, 3)}
        if self.fault is not None:
            return entry | {"fault": self.fault}
        if self.strip is None:
            return entry
        strip = self.strip
        return entry | {
            "fps": strip.fps,
            "size": strip.size,
            "count": strip.count,
            "cuts": strip.cuts,
            "step": strip.step,
        }


class Media:
    """Files that an action.yaml declares; only these can be asked for, by number."""

    def __init__(self, thread: BackgroundThread) -> None:
        self._thread = thread
        self._files: list[MediaFile] = []
        self._numbers: dict[Path, int] = {}
        self._open: list[Pictures] = []
        self._lock = Lock()

    def number(self, path: Path) -> int:
        """The number of a file, which is looked through from now on when it is new."""
        with self._lock:
            if path in self._numbers:
                return self._numbers[path]
            file = MediaFile(path)
            self._files.append(file)
            self._numbers[path] = len(self._files) - 1
        self._thread.add(("strip", path), lambda: self._look_through(file))
        return self._numbers[path]

    def file(self, number: int) -> MediaFile | None:
        """The file of a number."""
        return self._files[number] if 0 <= number < len(self._files) else None

    def count(self, path: Path) -> int | None:
        """Frames of a file, where they are counted."""
        strip = self._files[self._numbers[path]].strip if path in self._numbers else None
        return None if strip is None else strip.count

    def picture(self, number: int, kind: str, frame: int) -> bytes | None:
        """A frame of a file as JPEG (arguments as of `Pictures.get`); None where there is none.

        The files that were asked last stay open, because open ones take much memory.
        """
        file = self.file(number)
        if file is None or file.pictures is None:
            return None
        with self._lock:
            self._open = [*(p for p in self._open if p is not file.pictures), file.pictures]
            closing, self._open = self._open[:-MOST_OPEN], self._open[-MOST_OPEN:]
        for pictures in closing:
            pictures.close()
        return file.pictures.get(kind, frame)

    def documents(self) -> list[dict[str, Any]]:
        """All files for the page, by number."""
        return [file.document() for file in self._files]

    def close(self) -> None:
        """Close all files."""
        for file in self._files:
            if file.pictures is not None:
                file.pictures.close()

    def _look_through(self, file: MediaFile) -> None:
        def progress(share: float) -> None:
            if self._thread.stopping.is_set():
                raise ValueError("stopped")
            file.share = share

        try:
            strip = strip_of(file.path, progress)
        except (ValueError, OSError, MemoryError) as error:
            file.fault = str(error)
            return
        file.pictures = Pictures(file.path, strip)
        file.strip = strip
