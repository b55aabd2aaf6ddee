"""Results with one dictionary per person: VIBE, WHAM and tools in their format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.estimators.estimates import (
    Entries,
    PerformerBoxes,
    field,
    frame_ids,
    from_vectors,
    people_of,
    performer_rows,
    select_rows,
)
from imocap_core.io.pickles import read_results

MiddleOf = Callable[
    [dict[str, Any], int, str], Float[np.ndarray, "N 2"]
]  # person, number of frames, place in the file -> middle in pixels


def performer_of(
    path: Path, performer: PerformerBoxes, middle_px: MiddleOf
) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes, NaN where missing.

    ValueError names file, person, field, expected and got.
    """
    frames, track, middle, poses = [], [], [], []
    for number, (name, person) in enumerate(people_of(read_results(path), path).items()):
        where = f"{path}: person {name}"
        pose = field(person, "pose", ("N", 72), where)
        middle.append(middle_px(person, len(pose), where))
        frames.append(frame_ids(field(person, "frame_ids", (len(pose),), where), where))
        track.append(np.full(len(pose), number))
        poses.append(pose)
    entries = Entries(np.concatenate(frames), np.concatenate(track), np.concatenate(middle))
    rows = performer_rows(entries, performer, path)
    return select_rows(from_vectors(np.concatenate(poses)), rows)
