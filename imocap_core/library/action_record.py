"""What the shared store knows of an action: its files by their content, its results by their keys.

A record may come from anybody: every path in it leads into the action's folder, or it is refused.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from imocap_core.artifacts.shared import SharedFiles
from imocap_core.errors import WorkFailed
from imocap_core.identifiers import Id, is_portable
from imocap_core.limits import MAX_YAML_BYTES, must_be_small_enough
from imocap_core.pipeline.action import explain_faults

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
