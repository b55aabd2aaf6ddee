"""Which files of a folder this program wrote, so that people's files there are never lost.

    .made.json     name -> SHA-256 of every file that the program wrote into the folder

A file that is not listed, or has another content by now, is somebody's.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

from imocap_core.whole_files import write_whole

RECORD = ".made.json"


def record_made(folder: Path, names: Iterable[str]) -> None:
    """Add files of a folder (names relative to it) to those that the program wrote."""
    made = _made(folder) | {name: _digest(folder / name) for name in names}
    write_whole(folder / RECORD, json.dumps(made, indent=1, sort_keys=True) + "\n")


def peoples_files(folder: Path) -> list[str]:
    """The files of a folder, by their relative names, that somebody put there or changed."""
    made = _made(folder)
    return sorted(
        name
        for path in folder.rglob("*")
        if (path.is_file() or path.is_symlink()) and (name := _name(path, folder)) != RECORD
        if path.is_symlink() or name not in made or made[name] != _digest(path)
    )


def is_as_made(folder: Path, name: str) -> bool:
    """Whether the program wrote this file, and nobody has changed it since."""
    path, made = folder / name, _made(folder)
    return path.is_file() and not path.is_symlink() and made.get(name) == _digest(path)


def _made(folder: Path) -> dict[str, str]:
    """The record; empty where there is none, or it is damaged."""
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _name(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix()


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
