"""Write docs/artifacts.md from the schemas: `python tools/make_artifact_docs.py`.

Every field with its type, its shape, and the comment on its line in the source.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from imocap_core.artifacts import schemas
from imocap_core.artifacts.schemas.base import Shape, Value, dtype_of

TARGET = Path(__file__).resolve().parents[1] / "docs" / "artifacts.md"
BY_STAGE: dict[str, type[schemas.Artifact]] = {
    "keypoints": schemas.Keypoints,
    "camera_motion": schemas.CameraMotion,
    "initial_smpl": schemas.InitialSmpl,
    "sync": schemas.Sync,
    "smpl_ba": schemas.SmplBa,
    "redetect": schemas.Redetect,
    "refine_sync": schemas.RefineSync,
    "uncertainty": schemas.Uncertainty,
    "hands": schemas.Hands,
    "evaluate": schemas.Evaluate,
}
HEAD = """\
# Artifacts

*Made by `python tools/make_artifact_docs.py` from `imocap_core/artifacts/schemas/`; don't edit.*

One MCAP file for each stage: a JSON header on `/header` (with its JSON schema); for each array
one protobuf message `imocap.NdArray {name, dtype, shape, data}` on the topic of the array's path
in the header (`/videos/0/theta`); how it was made, as metadata; and files for the report, as
attachments. Letters in a shape are sizes shared by the fields of one value; `*` is any size.
Missing values are NaN.
How files are written, checked and identified: [the store](decisions.md#the-store).
"""


def document() -> str:
    """The whole page."""
    described: set[type[Value]] = set()
    parts = [HEAD]
    for stage, artifact in BY_STAGE.items():
        parts.append(f"\n## {stage}: `{artifact.__name__}`\n")
        for kind in _with_parts(artifact, described):
            if kind is not artifact:
                parts.append(f"\n### `{kind.__name__}`\n")
            parts.append(f"\n{inspect.cleandoc(kind.__doc__ or '')}\n\n{_fields(kind)}")
    return "".join(parts)


def _with_parts(kind: type[Value], described: set[type[Value]]) -> list[type[Value]]:
    """A value's class and those of the values inside it, each once in the whole page."""
    if kind in described:
        return []
    described.add(kind)
    kinds = [kind]
    for field in kind.model_fields.values():
        for inner in _classes(field.annotation):
            kinds += _with_parts(inner, described)
    return kinds


def _classes(annotation: Any) -> list[type[Value]]:
    if isinstance(annotation, type) and issubclass(annotation, Value):
        return [annotation]
    return [kind for part in get_args(annotation) for kind in _classes(part)]


def _fields(kind: type[Value]) -> str:
    comments = {name: f": {text}" for name, text in _comments(kind).items()}
    return "".join(
        f"* **`{name}`** {_type(field.annotation, field.metadata)}{comments.get(name, '')}\n"
        for name, field in kind.model_fields.items()
    )


def _type(annotation: Any, marks: Sequence[Any] = ()) -> str:
    """A type in words: an array by its dtype and shape, anything optional by what it may be."""
    shapes = [mark for mark in marks if isinstance(mark, Shape)]
    if shapes:
        return f"{dtype_of(annotation).name} {shapes[0]}"
    inner = get_args(annotation)
    if get_origin(annotation) is Annotated:
        return _type(inner[0], inner[1:])
    if get_origin(annotation) in (Union, UnionType):
        kinds = [_type(part) for part in inner if part is not NoneType]
        return " or ".join([*kinds, "None"] if NoneType in inner else kinds)
    text = str(annotation) if inner else annotation.__name__
    text = re.sub(r"Annotated\[(\w+), FieldInfo\(.*\)\]", r"\1", text)
    return "`" + re.sub(r"\b(?:\w+\.)+(\w+)", r"\1", text).replace("|", "or") + "`"


def _comments(kind: type[Value]) -> dict[str, str]:
    """Field name -> the comment on its line, of this class and those it extends."""
    comments: dict[str, str] = {}
    for parent in reversed(kind.__mro__):
        if issubclass(parent, Value) and parent is not Value:
            for line in inspect.getsource(parent).splitlines():
                if match := re.match(r"\s+(\w+): .*?  # (.*)", line):
                    comments[match[1]] = match[2].replace("|", "or")
    return comments


if __name__ == "__main__":
    TARGET.write_text(document(), encoding="utf-8")
