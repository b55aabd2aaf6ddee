"""PromptHMR: `results.pkl`, written by its video pipeline with joblib.

``people``: {track: {``frames`` (N,), ``bboxes`` (N, 4 or more) x0, y0, x1, y1 in pixels,
``smplx_cam``: {``pose`` (N, 165) axis-angle of SMPL-X's 55 joints, the root in camera axes,
``rotmat``, ``shape``, ``trans``, ...}, ``smplx_world``: ...}}. The first 22 joints are SMPL's
(SMPL's hands stay at rest). World motion, shape, camera, face and fingers are not used.
"""

from __future__ import annotations

from pathlib import Path

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

BODY = 66  # numbers of the 22 joints that SMPL-X and SMPL share
SMPLX = 165
IN_CAMERA = "smplx_cam"


def read_prompthmr(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes, NaN where missing.

    ValueError names file, person, field, expected and got.
    """
    content = read_results(path)
    people = content.get("people") if isinstance(content, dict) else content
    frames, track, middle, poses = [], [], [], []
    for number, (name, person) in enumerate(people_of(people, path).items()):
        where = f"{path}: people {name}"
        held = person if isinstance(person, dict) else {}
        pose = field(held.get(IN_CAMERA), "pose", ("N", SMPLX), f"{where}: {IN_CAMERA}")
        boxes = field(person, "bboxes", (len(pose), "4 or more"), where)
        if boxes.shape[1] < 4:
            raise ValueError(f"{where}: bboxes: expected x0, y0, x1, y1, got {boxes.shape}")
        middle.append(0.5 * (boxes[:, :2] + boxes[:, 2:4]))
        frames.append(frame_ids(field(person, "frames", (len(pose),), where), where))
        track.append(np.full(len(pose), number))
        poses.append(pose[:, :BODY])
    entries = Entries(np.concatenate(frames), np.concatenate(track), np.concatenate(middle))
    rows = performer_rows(entries, performer, path)
    return select_rows(from_vectors(np.concatenate(poses)), rows)
