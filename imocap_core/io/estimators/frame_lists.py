"""Results that hold a list of people for every frame, as users save what an estimator returned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.people import read_json, type_name
from imocap_core.io.estimators.estimates import (
    Entries,
    PerformerBoxes,
    field,
    performer_rows,
    select_rows,
)
from imocap_core.io.pickles import read_results


@dataclass(frozen=True)
class PersonInFrame:
    """One person's values in one frame; middle_px: NaN where the file has no place in the
    picture."""

    frame: int
    middle_px: Float[np.ndarray, "2"]
    values: Float[np.ndarray, "..."]


def frame_entries(content: Any, path: Path) -> list[Any]:
    """The entries of a list with one for each frame. ValueError when it is none, or empty."""
    listed = list(content) if isinstance(content, np.ndarray) and content.ndim else content
    if not isinstance(listed, list) or not listed:
        got = "an empty one" if isinstance(listed, list) else type_name(listed)
        raise ValueError(f"{path}: expected a list with one entry per frame, got {got}")
    return listed


def is_empty(people: Any) -> bool:
    """Whether a list or an array of people has none."""
    return people == [] if isinstance(people, list) else np.shape(people)[:1] == (0,)


def box_middles(boxes: Any, people: int, where: str) -> Float[np.ndarray, "P 2"]:
    """Middles of one frame's ``boxes``: left, top, width, height, and perhaps a score; pixels."""
    table = field({"boxes": boxes}, "boxes", (people, "4 or 5"), where)
    if table.shape[1] < 4:
        raise ValueError(f"{where}: boxes: expected left, top, width, height, got {table.shape}")
    return np.asarray(table[:, :2] + 0.5 * table[:, 2:4])


def read_saved(path: Path) -> Any:
    """The content of a JSON, .npy, .pkl or .pt file."""
    return read_json(path) if path.suffix == ".json" else read_results(path)


def of_performer(
    people: Sequence[PersonInFrame], performer: PerformerBoxes, path: Path
) -> Float[np.ndarray, "T *rest"]:
    """The performer's values at the used frames, NaN where missing. ValueError without anybody."""
    if not people:
        raise ValueError(f"{path}: expected at least one person, got none; run it again")
    middle = np.array([person.middle_px for person in people])
    places = middle if np.isfinite(middle).all() else None
    frames = np.array([person.frame for person in people], dtype=np.int64)
    entries = Entries(frames, np.zeros(len(people), dtype=np.int64), places)
    values = np.stack([person.values for person in people])
    return select_rows(values, performer_rows(entries, performer, path))
