"""SAM 3D Body: MHR's 70 keypoints in 3D, as its estimator returns them, saved by the user.

The estimator gives a list of people per picture, each a dictionary with ``pred_keypoints_3d`` (70,
3) metres in camera axes, ``bbox`` x0, y0, x1, y1 in pixels, and more. Accepted: a JSON, .npy or
.pkl file with a list of one entry per frame, each a list of people, one person, or {``frame``:
number, ``people``: list of people}; or an npz with ``pred_keypoints_3d`` (T, 70, 3) of one person
and, optionally, ``frames`` (T,). Of several people the performer is found by ``bbox``. The 13 of
the 70 that are joints of SMPL are used, in the order of `INDICES`; mesh, hands, shape, camera and
MHR's parameters are not.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.people import frame_number, read_json, type_name
from imocap_core.io.estimators.estimates import (
    Entries,
    PerformerBoxes,
    field,
    performer_rows,
    select_rows,
)
from imocap_core.io.estimators.joints_npz import JointsEstimate
from imocap_core.io.npz import load_arrays, numbers, rows_for_frames
from imocap_core.io.pickles import read_results

NAME, POINTS = "pred_keypoints_3d", 70
# Index among the 70 -> SMPL's joint.
INDICES = {
    **{5: "left_shoulder", 6: "right_shoulder", 7: "left_elbow", 8: "right_elbow"},
    **{9: "left_hip", 10: "right_hip", 11: "left_knee", 12: "right_knee"},
    **{13: "left_ankle", 14: "right_ankle", 41: "right_wrist", 62: "left_wrist", 69: "neck"},
}


def read_sam3d_body(path: Path, performer: PerformerBoxes) -> JointsEstimate:
    """The performer's joints at the used frames, metres, camera axes, NaN where missing.

    ValueError names file, frame, field, expected and got.
    """
    if path.suffix == ".npz":
        arrays = load_arrays(path)
        table = numbers(arrays, NAME, ("T", POINTS, 3), path)
        joints = table[rows_for_frames(arrays, len(table), performer.frames, path)]
    else:
        content = read_json(path) if path.suffix == ".json" else read_results(path)
        joints = _of_frames(content, performer, path)
    return JointsEstimate(joints[:, list(INDICES)], tuple(INDICES.values()))


def _of_frames(content: Any, performer: PerformerBoxes, path: Path) -> Float[np.ndarray, "T 70 3"]:
    listed = list(content) if isinstance(content, np.ndarray) else content
    if not isinstance(listed, list) or not listed:
        got = "an empty one" if isinstance(listed, list) else type_name(listed)
        raise ValueError(f"{path}: expected a list with one entry per frame, got {got}")
    frames, middle, joints = [], [], []
    for n, entry in enumerate(listed):
        for person, frame, where in _people(entry, n, path):
            frames.append(frame)
            joints.append(field(person, NAME, (POINTS, 3), where))
            box = np.full(4, np.nan)
            if person.get("bbox") is not None:
                box = field({"bbox": person["bbox"]}, "bbox", (4,), where)
            middle.append(0.5 * (box[:2] + box[2:]))
    if not joints:
        raise ValueError(f"{path}: expected at least one person, got none; run it again")
    places = np.array(middle)
    positions = places if np.isfinite(places).all() else None
    entries = Entries(np.array(frames), np.zeros(len(frames), dtype=np.int64), positions)
    return select_rows(np.stack(joints), performer_rows(entries, performer, path))


def _people(entry: Any, n: int, path: Path) -> list[tuple[dict[str, Any], int, str]]:
    """(person, frame, where) of one entry of the list."""
    where, frame, people = f"{path}: [{n}]", n, entry
    if isinstance(entry, dict) and NAME not in entry:
        frame = frame_number(entry.get("frame", n), f"{where}: frame")
        people = entry.get("people")
    elif isinstance(entry, dict):
        people = [entry]
    if isinstance(people, np.ndarray):
        people = list(people)
    if not isinstance(people, list) or not all(isinstance(person, dict) for person in people):
        raise ValueError(f"{where}: expected a list of people with {NAME}, got {type_name(people)}")
    return [(person, frame, f"{where}[{i}]") for i, person in enumerate(people)]
