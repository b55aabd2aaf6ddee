"""MeTRAbs: what `detect_poses(..., skeleton="smpl_24")` returns, saved by the user.

A list with one dictionary per frame: ``poses3d`` (people, 24, 3) millimetres in camera axes, in
SMPL's order, and ``boxes`` (people, 4 or more) left, top, width, height in pixels; a JSON, .npy,
.pkl or .pt file. ``poses2d`` are not used.
"""

from __future__ import annotations

from pathlib import Path

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.io.estimators.estimates import PerformerBoxes, field
from imocap_core.io.estimators.frame_lists import (
    PersonInFrame,
    box_middles,
    frame_entries,
    is_empty,
    of_performer,
    read_saved,
)
from imocap_core.io.estimators.joints_npz import JointsEstimate

MM = 1000.0  # a metre


def read_metrabs(path: Path, performer: PerformerBoxes) -> JointsEstimate:
    """The performer's joints at the used frames, metres, camera axes, NaN where missing.

    ValueError names file, frame, field, expected and got.
    """
    estimates: list[PersonInFrame] = []
    for frame, entry in enumerate(frame_entries(read_saved(path), path)):
        where = f"{path}: [{frame}]"
        if isinstance(entry, dict) and is_empty(entry.get("poses3d")):
            continue
        poses = field(entry, "poses3d", ("people", "joints", 3), where)
        if poses.shape[1] != len(SMPL_JOINTS):
            raise ValueError(
                f"{where}: poses3d: expected the 24 joints of skeleton='smpl_24', got {poses.shape}"
            )
        middle = box_middles(entry.get("boxes"), len(poses), where)
        estimates += [PersonInFrame(frame, m, p) for m, p in zip(middle, poses / MM, strict=True)]
    return JointsEstimate(of_performer(estimates, performer, path), SMPL_JOINTS)
