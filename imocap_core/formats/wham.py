"""WHAM: `wham_output.pkl`, as its demo writes it with joblib when asked to save.

{person: {``pose`` (N, 72) axis-angle, the root in camera axes, ``trans`` (N, 3), ``frame_ids``
(N,), ``betas``, ``verts``, ``pose_world``, ``trans_world``}}. Of several people the performer is
found by where ``trans`` is in the picture, at WHAM's usual focal length (the picture's diagonal).
World motion, shape and mesh are not used.
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


def read_wham(path: Path, wanted: Wanted) -> Array:
    """The performer's joint rotations (T, 24, 3, 3) in camera axes, NaN where there are none.

    ValueError names file, person, field, what is wrong.
    """
    frames, track, middle, poses = [], [], [], []
    for number, (name, person) in enumerate(people_of(read_results(path), path).items()):
        where = f"{path}: person {name}"
        pose = field(person, "pose", ("N", 72), where)
        trans = field(person, "trans", (len(pose), 3), where)
        frames.append(frame_ids(field(person, "frame_ids", (len(pose),), where), where))
        track.append(np.full(len(pose), number))
        focal_px = float(np.hypot(*wanted.size))
        depth = np.where(trans[:, 2:] > 0, trans[:, 2:], np.nan)
        middle.append(focal_px * trans[:, :2] / depth + 0.5 * np.array(wanted.size))
        poses.append(pose)
    entries = Entries(np.concatenate(frames), np.concatenate(track), np.concatenate(middle))
    rows = performer_rows(entries, wanted, path)
    return picked(from_vectors(np.concatenate(poses)), rows)
