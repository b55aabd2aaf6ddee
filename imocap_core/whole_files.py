"""Files that appear whole or not at all: written aside, synced, renamed.

A rename replaces a link instead of writing through it, so a link that somebody left where a file
is to be written leads nowhere.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO


@contextmanager
def draft_of(file: Path) -> Iterator[Path]:
    """An empty file beside `file`, which becomes `file` at once when the body ends, or never."""
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=".", suffix=f".part{file.suffix}", dir=file.parent)
    os.close(handle)
    try:
        yield Path(name)
        os.chmod(name, 0o644)
        _sync(name)
        os.replace(name, file)
        _sync(file.parent)
    finally:
        with suppress(FileNotFoundError):
            os.unlink(name)


@contextmanager
def appearing(file: Path) -> Iterator[BinaryIO]:
    """A stream whose content becomes `file` at once, or never."""
    with draft_of(file) as draft, draft.open("w+b") as stream:
        yield stream


def write_whole(file: Path, text: str) -> None:
    """Write a text (UTF-8, lines end as they are given)."""
    with appearing(file) as stream:
        stream.write(text.encode("utf-8"))


def is_whole_page(file: Path) -> bool:
    """Whether there is an HTML page, and it ends as one: not cut off by a full disk."""
    with suppress(OSError), file.open("rb") as stream:
        stream.seek(max(0, stream.seek(0, os.SEEK_END) - 64))
        return stream.read().rstrip().endswith(b"</html>")
    return False


def _sync(path: str | Path) -> None:
    """Wait until a file, or a folder's entries, are on the disk."""
    if os.name == "posix":
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
