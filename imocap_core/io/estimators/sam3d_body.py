"""SAM 3D Body: MHR's 70 keypoints in 3D, as its estimator returns them, saved by the user.

Accepted: the files of `sam3d_files`, in which the performer is found by ``bbox``; or an npz with
``pred_keypoints_3d`` (T, 70, 3) of one person and, optionally, ``frames`` (T,). All 70 points are
read; those that are joints of SMPL (`SMPL_POINTS`) are used by the fits. Mesh, camera, and MHR's
parameters of pose, shape and hands are of MHR's own body and not used: the joints' distances tell
the size, and ``pred_keypoints_2d`` are keypoints with feet and hands (`detectors.sam3d_body`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from imocap_core.io.estimators.estimates import PerformerBoxes, field
from imocap_core.io.estimators.frame_lists import PersonInFrame, of_performer
from imocap_core.io.estimators.joints_npz import JointsEstimate
from imocap_core.io.npz import load_arrays, numbers, rows_for_frames
from imocap_core.io.sam3d_files import NAMES, POINTS_3D, saved_people


def read_sam3d_body(path: Path, performer: PerformerBoxes) -> JointsEstimate:
    """The performer's 70 points at the used frames, metres, camera axes, NaN where missing.

    ValueError names file, frame, field, expected and got.
    """
    if path.suffix == ".npz":
        arrays = load_arrays(path)
        table = numbers(arrays, POINTS_3D, ("T", len(NAMES), 3), path)
        rows = rows_for_frames(arrays, len(table), performer.frames, path)
        return JointsEstimate(table[rows], NAMES)
    estimates = []
    for frame, people in saved_people(path):
        for person, where in people:
            box = np.full(4, np.nan)
            if person.get("bbox") is not None:
                box = field(person, "bbox", (4,), where)
            points = field(person, POINTS_3D, (len(NAMES), 3), where)
            estimates.append(PersonInFrame(frame, 0.5 * (box[:2] + box[2:]), points))
    return JointsEstimate(of_performer(estimates, performer, path), NAMES)
