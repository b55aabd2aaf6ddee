"""What was computed from files, remembered while they stay unchanged; a lock between processes.

A large video is hashed once, not by every command. A file counts as unchanged while its size,
modification time and inode do; a folder, while those of all its files do. This only decides
whether something is read again: keys and artifacts are made from contents alone.

Every process remembers for itself; `load_memory` and `save_memory` carry it over from one to the
next in `artifacts/.cache/files.json`, which may be deleted at any time.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import BinaryIO, TypeVar

from imocap_core import limits
from imocap_core.files import write_whole

RETRY_S = 0.1
UNWRITABLE = (errno.EROFS, errno.EACCES, errno.EPERM)

if sys.platform == "win32":
    import msvcrt

    def _try_lock(stream: BinaryIO) -> bool:
        stream.seek(0)
        try:
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

else:
    import fcntl

    def _try_lock(stream: BinaryIO) -> bool:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


@contextmanager
def exclusive(file: Path, waiting: Callable[[], None]) -> Iterator[None]:
    """Lock `file` while the body runs; if another process has it, call `waiting` and wait.

    On a disk that cannot be written to there is nothing to lock: the body runs all the same.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        opened = file.open("a+b")
    except OSError as error:
        if error.errno not in UNWRITABLE:
            raise
        yield
        return
    with opened as stream:
        if not _try_lock(stream):
            waiting()
            while not _try_lock(stream):
                time.sleep(RETRY_S)
        yield


FILE = Path(".cache") / "files.json"
FORMAT = 2  # raise when what is computed from a file means something else
SETTLED_NS = 2_000_000_000  # a file changed later than this ago may change again unnoticed

Value = TypeVar("Value")  # of JSON


class _Memory:
    def __init__(self) -> None:
        self.entries: dict[str, tuple[str, object]] = {}  # kind and path: signature, value
        self.changed = False


@cache
def _memory() -> _Memory:
    return _Memory()


def remembered(kind: str, path: Path, compute: Callable[[Path], Value]) -> Value:
    """`compute(path)`, or what it returned for this content of the file or folder before.

    kind: names the computation; the same for the same `compute`. OSError when there is no file.
    """
    name = f"{kind} {os.path.abspath(path)}"
    signature, newest_ns = _signature(path)
    entry = _memory().entries.get(name)
    if entry is not None and entry[0] == signature:
        return entry[1]  # type: ignore[return-value]
    value = compute(path)
    if time.time_ns() - newest_ns > SETTLED_NS and _signature(path)[0] == signature:
        _memory().entries[name] = (signature, value)
        _memory().changed = True
    return value


def load_memory(folder: Path) -> None:
    """Remember what was saved below a folder of artifacts, if anything was."""
    with suppress(OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError):
        saved = json.loads((folder / FILE).read_text(encoding="utf-8"))
        if saved["made_by"] == _made_by():
            entries = {name: (str(s), value) for name, (s, value) in saved["entries"].items()}
            _memory().entries = entries | _memory().entries


def save_memory(folder: Path) -> None:
    """Save what is remembered below a folder of artifacts, where that folder exists."""
    if not _memory().changed or not folder.is_dir():
        return
    entries = {
        name: entry
        for name, entry in _memory().entries.items()
        if os.path.exists(name.partition(" ")[2])
    }
    text = json.dumps({"made_by": _made_by(), "entries": entries}, separators=(",", ":"))
    with suppress(OSError):
        write_whole(folder / FILE, text)
        _memory().changed = False


def files_below(folder: Path) -> list[str]:
    """Paths of all files in a folder and its folders, relative to it, in a fixed order."""
    return [relative for relative, _ in sorted(_entries(folder), key=lambda e: e[0].split("/"))]


def _entries(folder: Path) -> Iterator[tuple[str, os.stat_result]]:
    """All files below a folder. OSError where they are more than a folder of inputs has."""
    files, size = 0, 0
    for relative, status in _walked(folder):
        files, size = files + 1, size + status.st_size
        if files > limits.MAX_FOLDER_FILES or size > limits.MAX_FOLDER_BYTES:
            most = f"{limits.MAX_FOLDER_FILES:,} files, {limits.MAX_FOLDER_BYTES >> 30} GiB"
            raise OSError(errno.EFBIG, f"more than {most} below it", str(folder))
        yield relative, status


def _walked(folder: Path) -> Iterator[tuple[str, os.stat_result]]:
    waiting = [""]
    while waiting:
        inside = waiting.pop()
        with os.scandir(folder / inside) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(f"{inside}{entry.name}/")
                elif entry.is_file():
                    yield inside + entry.name, entry.stat()


def _signature(path: Path) -> tuple[str, int]:
    """What changes when a file or folder does, and the newest modification time in it (ns)."""
    now = path.stat()
    if not path.is_dir():
        return f"{now.st_size} {now.st_mtime_ns} {now.st_ino}", now.st_mtime_ns
    sha, newest_ns = hashlib.sha256(), now.st_mtime_ns
    for relative, status in sorted(_entries(path), key=lambda entry: entry[0]):
        line = f"{relative}\0{status.st_size}\0{status.st_mtime_ns}\0{status.st_ino}\n"
        sha.update(line.encode())
        newest_ns = max(newest_ns, status.st_mtime_ns)
    return sha.hexdigest(), newest_ns


def _made_by() -> str:
    """The code that computed the values; another Python may parse sources differently."""
    return f"{FORMAT} {sys.version}"
