"""What the shared store knows of an action: its files, its results, and their record.

A record may come from anybody: every path in it leads into the action's folder, or it is refused.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from imocap_core.artifacts.file_memory import files_below
from imocap_core.artifacts.shared_store import SharedFiles
from imocap_core.errors import WorkFailed
from imocap_core.identifiers import Id, is_portable
from imocap_core.limits import (
    MAX_FOLDER_BYTES,
    MAX_FOLDER_FILES,
    MAX_YAML_BYTES,
    must_be_small_enough,
)
from imocap_core.pipeline.action import (
    DETECT,
    FILE_NAME,
    FOLDERS,
    Action,
    Declaration,
    explain_faults,
    placed,
)
from imocap_core.pipeline.graph import RunSettings
from imocap_core.pipeline.yaml_file import edited_text
from imocap_core.workspace import check_files


def action_files(action: Action, settings: RunSettings) -> dict[str, Path]:
    """Path in the action's folder -> file; that of a folder ends with /.

    WorkFailed when one does not exist, or lies elsewhere.
    """
    return _files(action, settings, action.videos)


def portable_files(action: Action, settings: RunSettings, aside: Path) -> dict[str, Path]:
    """As `action_files`, with files of videos that lie elsewhere where they belong in the folder.

    Args:
        aside: a folder for the action.yaml that names these places, with its comments and all else
            as they are; it is written where it differs.

    WorkFailed when a file does not exist, or has no place on another machine.
    """
    videos = placed(action.videos)
    files = _files(action, settings, videos)
    if videos != action.videos:
        text = action.file.read_bytes().decode("utf-8")
        files[FILE_NAME] = aside / FILE_NAME
        files[FILE_NAME].write_bytes(_with_places(text, videos).encode("utf-8"))
    return files


def _files(action: Action, settings: RunSettings, videos: Sequence[Declaration]) -> dict[str, Path]:
    check_files(action)
    files = {FILE_NAME: action.file}
    for field, given, place in _named(action, settings, videos):
        files |= _entry(action, field, given, place)
    return files


def _named(
    action: Action, settings: RunSettings, videos: Sequence[Declaration]
) -> Iterator[tuple[str, str, str]]:
    """Field of action.yaml, path as it has it, and the place in the folder, as in `videos`."""
    for i, (video, there) in enumerate(zip(action.videos, videos, strict=True)):
        for field in FOLDERS:
            given = getattr(video, field)
            if given not in (None, DETECT):
                yield f"videos.{i}.{field}", given, getattr(there, field)
    for name in action.truth_files:
        yield "truth", name, name
    detect = settings.params.detect
    if any(video.detected for video in action.videos) and detect.detector == "rtmlib":
        models = {
            "rtmlib_person_model": detect.rtmlib_person_model,
            "rtmlib_pose_model": detect.rtmlib_pose_model,
        }
        for name, path in models.items():
            if path is not None:
                yield f"params.detect.{name}", path, path


def _entry(action: Action, field: str, given: str, place: str) -> dict[str, Path]:
    path = action.folder / given
    relative = Path(os.path.normpath(place)).as_posix()
    try:
        must_be_inside(relative)
    except ValueError:
        raise WorkFailed(
            f"{action.file}: {field}: {given} lies outside the action's folder, or has a name that "
            "other systems do not take, and so has no place on another machine; move it into the "
            "folder under a plain name, or make a link to it there, and name that"
        ) from None
    return {relative + "/" if path.is_dir() else relative: path}


def _with_places(text: str, videos: Sequence[Declaration]) -> str:
    """An action.yaml that names the files of its videos where `videos` has them."""

    def change(content: Any) -> None:
        for entry, video in zip(content["videos"], videos, strict=True):
            for field in FOLDERS:
                place = getattr(video, field)
                if place is not None and entry[field] != place:
                    entry[field] = place

    return edited_text(text, change)


SHA256 = re.compile(r"[0-9a-f]{64}")
UNSAFE = re.compile(r'[\x00-\x1f\x7f\\:*?"<>|]')
MAX_PARTS, MAX_PATH_BYTES = 16, 1024
Digest = Annotated[str, Field(pattern=f"^{SHA256.pattern}$")]


def must_be_inside(path: str, *, hidden: bool = False) -> str:
    """The path; ValueError unless it leads from a folder to something inside of it, on any system.

    hidden: its first part may begin with a dot.
    """
    parts = PurePosixPath(path).parts
    wrong = not parts or len(parts) > MAX_PARTS or len(path.encode()) > MAX_PATH_BYTES
    wrong = wrong or not all(map(is_portable, parts))
    if wrong or path.startswith("/") or ".." in parts or UNSAFE.search(path):
        raise ValueError(f"expected a path inside the action's folder, got {path!r:.120}")
    if parts[0].startswith(".") and not hidden:
        raise ValueError(f"expected no hidden file or folder, got {path!r:.120}")
    return path


PathInside = Annotated[str, AfterValidator(must_be_inside)]


class ActionRecord(BaseModel):
    """An action in the shared store.

    files: path in the action's folder -> content; that of a folder ends with /. results: stage ->
    key of the current result.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = 1
    name: Id
    files: dict[PathInside, Digest]
    results: dict[Id, Digest] = Field(default_factory=dict)


def record_name(action: str) -> str:
    """Where the record of an action lies in the store."""
    return f"actions/{action}.json"


def input_name(digest: str) -> str:
    """Where a file of an action lies in the store."""
    return f"inputs/{digest}"


def read_record(shared: SharedFiles, name: str) -> ActionRecord | None:
    """The record of a name of the store; None when there is none.

    WorkFailed when it is no record, or a path in it leads elsewhere.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "record.json"
        if not shared.fetch(name, file):
            return None
        place = f"{shared.url}/{name}"
        try:
            must_be_small_enough(file, MAX_YAML_BYTES)
            return ActionRecord.model_validate_json(file.read_bytes())
        except ValidationError as error:
            raise WorkFailed(explain_faults(error, place)) from None
        except (ValueError, RecursionError) as error:
            raise WorkFailed(f"{place}: {error}") from None


def write_record(shared: SharedFiles, name: str, record: ActionRecord) -> None:
    """Publish a record."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "record.json"
        file.write_text(record.model_dump_json(indent=1) + "\n", encoding="utf-8")
        shared.publish(file, name)


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
