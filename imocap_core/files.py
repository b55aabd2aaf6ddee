"""Files written whole, and which files of a folder this program wrote.

Files that appear whole or not at all: written aside, synced, renamed. A rename replaces a link
instead of writing through it, so a link that somebody left where a file is to be written leads
nowhere.

Which files of a folder this program wrote, so that people's files there are never lost.

    .made.json     name -> SHA-256 of every file that the program wrote into the folder

A file that is not listed, or has another content by now, is somebody's.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO


def writer() -> str:
    """The beginning of a draft's name that says which process on which machine writes it."""
    return f"{_machine()}-{os.getpid()}-"


def writer_has_ended(draft: Path) -> bool:
    """Whether a draft's name says that it was written by a process of this machine that is gone."""
    match = re.search(rf"\.(?:[a-z]+-)?{re.escape(_machine())}-(\d+)-", draft.name)
    if match is None or sys.platform == "win32":
        return False
    try:
        os.kill(int(match[1]), 0)  # sends nothing
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False


@cache
def _machine() -> str:
    """This machine since it was started; a container's processes are another's."""
    names = [platform.node()]
    with suppress(OSError):
        names.append(Path("/proc/sys/kernel/random/boot_id").read_text())
        names.append(os.readlink("/proc/self/ns/pid"))
    return hashlib.sha256("".join(names).encode()).hexdigest()[:12]


@contextmanager
def atomic_write(file: Path) -> Iterator[Path]:
    """An empty file beside `file`, which becomes `file` at once when the body ends, or never.

    Drafts that killed processes left in the folder are removed.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    for draft in file.parent.glob(f".{_machine()}-*"):
        if writer_has_ended(draft):
            with suppress(OSError):
                draft.unlink()
    suffix = f".part{file.suffix}"
    handle, name = tempfile.mkstemp(prefix=f".{writer()}", suffix=suffix, dir=file.parent)
    os.close(handle)
    try:
        yield Path(name)
        os.chmod(name, 0o644)
        _sync(name)
        os.replace(name, file)
        _sync(file.parent)
    except OSError as error:
        if error.filename is None and error.errno is not None:  # a full disk names no file
            error.filename = str(file)
        raise
    finally:
        with suppress(FileNotFoundError):
            os.unlink(name)


@contextmanager
def draft_folder(parent: Path, name: str) -> Iterator[Path]:
    """An empty hidden folder in `parent`, removed when the body ends; so are those of this name (of
    letters) that killed processes left there."""
    parent.mkdir(parents=True, exist_ok=True)
    for abandoned in parent.glob(f".{name}-{_machine()}-*"):
        if writer_has_ended(abandoned):
            shutil.rmtree(abandoned, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix=f".{name}-{writer()}", dir=parent) as folder:
        yield Path(folder)


def publish_once(draft: Path, file: Path) -> None:
    """Make a finished draft the file at once, unless somebody did in the meantime: theirs stays.

    For files that are named by all that they depend on. Whoever reads the first one can rely on it
    staying as it is.
    """
    _sync(draft)
    try:
        os.link(draft, file)
    except FileExistsError:
        pass
    except OSError:  # a disk without hard links
        if not file.exists():
            os.replace(draft, file)
    draft.unlink(missing_ok=True)
    _sync(file.parent)


@contextmanager
def appearing(file: Path) -> Iterator[BinaryIO]:
    """A stream whose content becomes `file` at once, or never."""
    with atomic_write(file) as draft, draft.open("w+b") as stream:
        yield stream


def write_whole(file: Path, text: str) -> None:
    """Write a text (UTF-8, lines end as they are given)."""
    with appearing(file) as stream:
        stream.write(text.encode("utf-8"))


def write_csv(file: Path, head: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a table, comma-separated, with its heading."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream, lineterminator="\n").writerows([head, *rows])


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


RECORD = ".made.json"


def record_made(folder: Path, names: Iterable[str]) -> None:
    """Add files of a folder (names relative to it) to those that the program wrote."""
    made = _made(folder) | {name: sha256_of(folder / name) for name in names}
    write_whole(folder / RECORD, json.dumps(made, indent=1, sort_keys=True) + "\n")


def user_files(folder: Path) -> list[str]:
    """The files of a folder, by their relative names, that somebody put there or changed."""
    made = _made(folder)
    return sorted(
        name
        for path in folder.rglob("*")
        if path.is_file() or path.is_symlink()
        if (name := path.relative_to(folder).as_posix()) != RECORD
        if path.is_symlink() or name not in made or made[name] != sha256_of(path)
    )


def is_as_made(folder: Path, name: str) -> bool:
    """Whether the program wrote this file, and nobody has changed it since."""
    path, made = folder / name, _made(folder)
    return path.is_file() and not path.is_symlink() and made.get(name) == sha256_of(path)


def _made(folder: Path) -> dict[str, str]:
    """The record; empty where there is none, or it is damaged."""
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def sha256_of(file: Path) -> str:
    """The digest of a file's content."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def draft_prefix(folder: Path) -> str:
    """The beginning of the name of the hidden folder in which `folder` is made."""
    return f".{folder.name}.{writer()}"


def sweep_drafts(folder: Path) -> None:
    """Delete what killed processes of this machine left beside `folder`.

    One that was killed while it replaced an older folder has it still: that is put back.
    """
    for aside in sorted(folder.parent.glob(f".{folder.name}.*")):
        if not writer_has_ended(aside) or aside.is_symlink():
            continue
        if (aside / "old").is_dir() and not folder.exists():
            os.replace(aside / "old", folder)
        shutil.rmtree(aside, ignore_errors=True)


# A calibrated rig's truth beside action.yaml (`pose2sim_truth` reads it).
CALIBRATION = "calibration.npz"
REFERENCE = "trc_reference.npz"
RIG_FILES = (CALIBRATION, REFERENCE)


def has_pose2sim_truth(folder: Path) -> bool:
    """Whether an action's folder has both files."""
    return all((folder / name).is_file() for name in RIG_FILES)
