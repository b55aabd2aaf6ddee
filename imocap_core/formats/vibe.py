"""VIBE: `vibe_output.pkl`, as its demo writes it with joblib (and tools that follow it).

{person: {``pose`` (N, 72) axis-angle, the root in camera axes, ``bboxes`` (N, 4) middle, width and
height in pixels, ``frame_ids`` (N,), ``betas``, cameras, joints, ``verts``}}. Of several people
the performer is found by the boxes. Cameras, shape, joints and mesh are not used.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from imocap_core.formats.estimates import (
    Array,
    Entries,
    Wanted,
    field,
    frame_ids,
    from_vectors,
    people_of,
    performer_rows,
    picked,
)
from imocap_core.formats.pickles import read_results


def read_vibe(path: Path, wanted: Wanted) -> Array:
    """The performer's joint rotations (T, 24, 3, 3) in camera axes, NaN where there are none.

    ValueError names file, person, field, what is wrong.
    """
    frames, track, middle, poses = [], [], [], []
    for number, (name, person) in enumerate(people_of(read_results(path), path).items()):
        where = f"{path}: person {name}"
        pose = field(person, "pose", ("N", 72), where)
        middle.append(field(person, "bboxes", (len(pose), 4), where)[:, :2])
        frames.append(frame_ids(field(person, "frame_ids", (len(pose),), where), where))
        track.append(np.full(len(pose), number))
        poses.append(pose)
    entries = Entries(np.concatenate(frames), np.concatenate(track), np.concatenate(middle))
    rows = performer_rows(entries, wanted, path)
    return picked(from_vectors(np.concatenate(poses)), rows)
