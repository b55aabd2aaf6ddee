"""Side files of an artifact: their names, the folder that they become; links in a store.

An artifact may come from anybody, and its attachments name themselves. Only relative names of plain
parts are taken, so that no file is written outside its folder.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from imocap_core.errors import WorkFailed
from imocap_core.files import record_made, user_files
from imocap_core.identifiers import is_portable


def refuse_links(store: Path, *inside: str) -> None:
    """WorkFailed when a link in these folders of a store leads out of the store.

    The store itself may be a link.
    """
    home = store.resolve()
    for link in (link for name in inside for link in _links(store / name)):
        if not link.resolve().is_relative_to(home):
            raise WorkFailed(
                f"{link} is a link to {os.readlink(link)}, outside {store}: nothing is written "
                f"through it. Remove the link (to keep results on another disk, link {store} as a "
                f"whole)"
            )


def _links(path: Path) -> Iterator[Path]:
    if path.is_symlink():
        yield path
        return
    for folder, folders, files in os.walk(path):
        yield from (
            link for name in [*folders, *files] if (link := Path(folder, name)).is_symlink()
        )


PART = r"[A-Za-z0-9_][A-Za-z0-9_. -]{0,127}"  # of a path: no "..", no hidden file, no drive
NAME = re.compile(rf"{PART}(?:/{PART}){{0,7}}")


def check_names(names: Iterable[str]) -> None:
    """ValueError unless all names are distinct files below one folder."""
    names = list(names)
    for name in names:
        if not (NAME.fullmatch(name) and all(map(is_portable, name.split("/")))):
            raise ValueError(
                f"a side file is named {name!r:.80}: expected a relative name of letters, digits, "
                f"_ . - and spaces, in folders or not, that every system takes"
            )
    folders = {
        "/".join(name.split("/")[:i]) for name in names for i in range(1, name.count("/") + 1)
    }
    plain = [name.lower() for name in names]
    folders = {folder.lower() for folder in folders}
    doubled = sorted({name for name in plain if plain.count(name) > 1 or name in folders})
    if doubled:
        raise ValueError(f"two side files are named {doubled[0]!r:.80}")


def has_files(folder: Path, files: Mapping[str, bytes]) -> bool:
    """Whether a folder contains these files."""
    return all(
        (folder / name).is_file() and (folder / name).read_bytes() == data
        for name, data in files.items()
    )


def replace_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Make `folder` contain these files, at once, and of its former ones only people's.

    Where a new file has the name of one of theirs, theirs gets a ~ at its end.
    """
    check_names(files)
    fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    old = fresh.with_name(fresh.name + "-old")
    try:
        fresh.chmod(0o755)
        for name, data in files.items():
            (fresh / name).parent.mkdir(parents=True, exist_ok=True)
            (fresh / name).write_bytes(data)
        record_made(fresh, files)
        for name in sorted(user_files(folder), key=lambda name: name in files):
            target = fresh / name
            while target.exists() or target.is_symlink():
                target = target.with_name(target.name + "~")
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(folder / name, target, follow_symlinks=False)
        if folder.exists():
            os.replace(folder, old)
        try:
            os.replace(fresh, folder)
        except OSError:
            if old.exists():
                os.replace(old, folder)
            raise
    finally:
        for leftover in (fresh, old):
            shutil.rmtree(leftover, ignore_errors=True)
