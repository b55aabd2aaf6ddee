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
def appearing(file: Path) -> Iterator[BinaryIO]:
    """A stream whose content becomes `file` at once, or never."""
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=".", suffix=".part", dir=file.parent)
    try:
        with os.fdopen(handle, "w+b") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(name, 0o644)
        os.replace(name, file)
        _sync_folder(file.parent)
    finally:
        with suppress(FileNotFoundError):
            os.unlink(name)


def write_whole(file: Path, text: str) -> None:
    """Write a text (UTF-8, lines end as they are given)."""
    with appearing(file) as stream:
        stream.write(text.encode("utf-8"))


def _sync_folder(folder: Path) -> None:
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
