"""Artifacts with damaged parts and right checksums, as a hostile folder has them."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.artifacts import codec
from imocap_core.artifacts.schemas import Keypoints
from imocap_core.errors import ArtifactCorrupt
from imocap_core.pipeline.keys import differences
from imocap_core.pipeline.stage import Recipe
from tests.made_keypoints import made_keypoints

VIDEO = made_keypoints(np.arange(3))
RECIPE = Recipe(
    code={"stages.keypoints": "c"},
    params={"keypoints": {"gap_s": 0.5}},
    seed=3,
    inputs={},
    reads={"videos v1": "r"},
)


def write_parts(folder: Path) -> Path:
    """The header and the recipe of an artifact, as JSON."""
    packed = codec.pack(Keypoints(videos=[VIDEO]))
    provenance = {name: json.loads(text) for name, text in RECIPE.provenance().items()}
    file = folder / "parts.json"
    parts = {"header": json.loads(packed.header), "provenance": provenance}
    file.write_text(json.dumps(parts))
    return file


def read_recoded(file: Path) -> None:
    """Read the artifact of these parts; what is no JSON, or has no parts, is none."""
    try:
        parts = json.loads(file.read_bytes())
        provenance = {name: _text(part) for name, part in parts["provenance"].items()}
        header = json.dumps(parts["header"]).encode()
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return
    arrays = codec.pack(Keypoints(videos=[VIDEO])).arrays
    recoded = file.with_name(f"{file.name}.mcap")
    with recoded.open("wb") as stream:
        codec.write(stream, codec.Content("Keypoints", header, arrays, provenance), {})
    content = codec.read(recoded)
    differences(content.provenance, RECIPE)
    try:
        codec.unpack(content, Keypoints)
    except ArtifactCorrupt as error:
        raise ArtifactCorrupt(f"{file}: {error}") from None


def _text(part: Any) -> str:
    return part if isinstance(part, str) else json.dumps(part)
