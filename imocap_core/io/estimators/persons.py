"""Results of video estimators that hold one dictionary a person: VIBE, WHAM and their kin."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.io.estimators.estimates import (
    Array,
    Entries,
    PerformerBoxes,
    field,
    frame_ids,
    from_vectors,
    people_of,
    performer_rows,
    picked,
)
from imocap_core.io.pickles import read_results

MiddleOf = Callable[[dict[str, Any], int, str], Array]  # person, count, place -> (N, 2) pixels


def performer_of(path: Path, performer: PerformerBoxes, middle_px: MiddleOf) -> Array:
    """The performer's joint rotations (T, 24, 3, 3) in camera axes, NaN where there are none.

    ValueError names file, person, field, what is wrong.
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
    return picked(from_vectors(np.concatenate(poses)), rows)
