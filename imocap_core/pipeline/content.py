"""Digests of files and folders by what they hold."""

from __future__ import annotations

import hashlib
from pathlib import Path

from imocap_core.artifacts.file_memory import files_below, remembered
from imocap_core.errors import WorkFailed


def content_digest(path: Path) -> str:
    """SHA-256 of a file's bytes, or of a folder's files and their names in it.

    Computed again only where something has changed. WorkFailed when it can't be read.
    """
    if path.exists() and not path.is_dir() and not path.is_file():
        raise WorkFailed(f"{path}: expected a file or a folder, got something else (a pipe?)")
    try:
        return remembered("content", path, _digest)
    except OSError as error:
        raise WorkFailed(f"cannot read {error.filename or path}: {error.strerror}") from None


def _digest(path: Path) -> str:
    if not path.is_dir():
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    sha = hashlib.sha256()
    for relative in files_below(path):
        sha.update(relative.encode() + b"\0")
        sha.update(bytes.fromhex(_digest(path / relative)))
    return sha.hexdigest()
