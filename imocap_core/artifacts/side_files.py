"""Side files of an artifact (a stage's report): their names, and the folder that they become.

An artifact may come from anybody, and its attachments name themselves. Only relative names of plain
parts are taken, so that no file is written outside its folder.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

PART = r"[A-Za-z0-9_][A-Za-z0-9_. -]{0,127}"  # of a path: no "..", no hidden file, no drive
NAME = re.compile(rf"{PART}(?:/{PART}){{0,7}}")


def check_names(names: Iterable[str]) -> None:
    """ValueError unless all names are distinct files below one folder."""
    names = list(names)
    for name in names:
        if not NAME.fullmatch(name):
            raise ValueError(
                f"a side file is named {name!r:.80}: expected a relative name of letters, digits, "
                f"_ . - and spaces, in folders or not"
            )
    folders = {
        "/".join(name.split("/")[:i]) for name in names for i in range(1, name.count("/") + 1)
    }
    doubled = sorted({name for name in names if names.count(name) > 1 or name in folders})
    if doubled:
        raise ValueError(f"two side files are named {doubled[0]!r:.80}")


def same_files(folder: Path, files: Mapping[str, bytes], *, and_more: bool) -> bool:
    """Whether a folder contains these files, and no others unless `and_more`."""
    present = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file()}
    complete = present.keys() >= files.keys() if and_more else present.keys() == files.keys()
    return complete and all(present[name].read_bytes() == data for name, data in files.items())


def replace_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Make `folder` contain these files and no others, at once."""
    check_names(files)
    fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    old = fresh.with_name(fresh.name + "-old")
    try:
        fresh.chmod(0o755)
        for name, data in files.items():
            (fresh / name).parent.mkdir(parents=True, exist_ok=True)
            (fresh / name).write_bytes(data)
        if folder.exists():
            os.replace(folder, old)
        os.replace(fresh, folder)
    finally:
        for leftover in (fresh, old):
            shutil.rmtree(leftover, ignore_errors=True)
