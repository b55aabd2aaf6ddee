"""A lock between processes; the operating system releases it when its process ends."""

from __future__ import annotations

import errno
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

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
