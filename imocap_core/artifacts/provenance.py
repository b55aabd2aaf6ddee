"""What a result says of how it was made: a recipe as JSON texts, checked where it is read.

An artifact may come from somebody else; whoever reads its recipe relies on these forms.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from imocap_core.errors import ArtifactCorrupt

MAX_NESTING = 50  # brackets within brackets of one text


def check_provenance(provenance: Mapping[str, str]) -> None:
    """ArtifactCorrupt when a part of the recipe is not of its form; parts may be missing."""
    for name, fits in FORMS.items():
        if name in provenance and not _is_json_of(provenance[name], fits):
            raise ArtifactCorrupt(f"its provenance has no usable {name}")


def _is_json_of(text: str, fits: Callable[[Any], bool]) -> bool:
    try:
        value = json.loads(text)
        return _is_shallow(value, MAX_NESTING) and fits(value)
    except (ValueError, RecursionError):
        return False


def _is_shallow(value: Any, levels: int) -> bool:
    if not isinstance(value, (dict, list)):
        return True
    parts = value.values() if isinstance(value, dict) else value
    return levels > 0 and all(_is_shallow(part, levels - 1) for part in parts)


def _is_number(value: Any) -> bool:
    return isinstance(value, int)


def _are_texts(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(part, str) for part in value.values())


def _are_groups(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(part, dict) for part in value.values())


FORMS: dict[str, Callable[[Any], bool]] = {
    "code": _are_texts,
    "params": _are_groups,
    "seed": _is_number,
    "inputs": _are_texts,
    "reads": _are_texts,
    "format": _is_number,
}
