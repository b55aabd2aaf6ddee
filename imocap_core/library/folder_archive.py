"""A folder of an action as one file: a detector writes a file a frame, which a store takes slowly
one by one."""

from __future__ import annotations

import shutil
import zipfile
import zlib
from pathlib import Path

from imocap_core.artifacts.file_memory import files_below
from imocap_core.library.action_record import must_be_inside
from imocap_core.limits import MAX_FOLDER_BYTES, MAX_FOLDER_FILES

MOMENT = (1980, 1, 1, 0, 0, 0)
UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError)


def pack(folder: Path, archive: Path) -> None:
    """Write all files of a folder into an archive.

    ValueError for a name that another system does not take.
    """
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=3) as packed:
        for name in files_below(folder):
            member = zipfile.ZipInfo(must_be_inside(name, hidden=True), MOMENT)
            member.compress_type = zipfile.ZIP_DEFLATED
            with (folder / name).open("rb") as source, packed.open(member, "w") as target:
                shutil.copyfileobj(source, target)


def unpack(archive: Path, folder: Path) -> None:
    """Write the files of an archive below a folder. ValueError when it cannot be read, a name leads
    elsewhere, or it is too large; nothing has been written then but what came before."""
    try:
        with zipfile.ZipFile(archive) as packed:
            members = [member for member in packed.infolist() if not member.is_dir()]
            size = sum(member.file_size for member in members)
            if len(members) > MAX_FOLDER_FILES or size > MAX_FOLDER_BYTES:
                raise ValueError(f"unpacks to {len(members):,} files of {size:,} bytes")
            for member in members:
                file = folder / must_be_inside(member.filename, hidden=True)
                file.parent.mkdir(parents=True, exist_ok=True)
                with packed.open(member) as source, file.open("wb") as target:
                    shutil.copyfileobj(source, target)
    except UNREADABLE as error:
        raise ValueError(f"is no readable archive ({str(error)[:200]})") from None
