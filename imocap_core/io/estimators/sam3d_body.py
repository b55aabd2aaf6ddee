"""SAM 3D Body: MHR's 70 keypoints in 3D, as its estimator returns them, saved by its user.

The estimator gives a list of people a picture, each a dictionary with ``pred_keypoints_3d``
(70, 3) metres in camera axes, ``bbox`` x0, y0, x1, y1 in pixels, and more. Read here: a JSON,
.npy or .pkl file with a list of one entry a frame, each such a list of people, one such person, or
{``frame``: number, ``people``: such a list}; or an npz with ``pred_keypoints_3d`` (T, 70, 3) of one
person and, optionally, ``frames`` (T,). Of several people the performer is found by ``bbox``.
Used are the 13 of the 70 that are joints of SMPL, in the order of its list of names: not the mesh,
hands, shape, camera or MHR's own parameters.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.io.detectors.people import frame_number, read_json, type_name
from imocap_core.io.estimators.estimates import (
    Array,
    Entries,
    PerformerBoxes,
    field,
    performer_rows,
    picked,
)
from imocap_core.io.estimators.joints_npz import JointsEstimate
from imocap_core.io.npz import load_arrays, numbers, rows_for_frames
from imocap_core.io.pickles import read_results

NAME, POINTS = "pred_keypoints_3d", 70
# Place among the 70 -> SMPL's joint.
PLACES = {
    **{5: "left_shoulder", 6: "right_shoulder", 7: "left_elbow", 8: "right_elbow"},
    **{9: "left_hip", 10: "right_hip", 11: "left_knee", 12: "right_knee"},
    **{13: "left_ankle", 14: "right_ankle", 41: "right_wrist", 62: "left_wrist", 69: "neck"},
}


def read_sam3d_body(path: Path, performer: PerformerBoxes) -> JointsEstimate:
    """The performer's joints at the used frames, metres, camera axes, NaN where there are none.

    ValueError names file, frame, field, what is wrong.
    """
    if path.suffix == ".npz":
        arrays = load_arrays(path)
        table = numbers(arrays, NAME, ("T", POINTS, 3), path)
        found = table[rows_for_frames(arrays, len(table), performer.frames, path)]
    else:
        content = read_json(path) if path.suffix == ".json" else read_results(path)
        found = _of_frames(content, performer, path)
    return JointsEstimate(found[:, list(PLACES)], tuple(PLACES.values()))


def _of_frames(content: Any, performer: PerformerBoxes, path: Path) -> Array:
    listed = list(content) if isinstance(content, np.ndarray) else content
    if not isinstance(listed, list) or not listed:
        got = "an empty one" if listed == [] else type_name(listed)
        raise ValueError(f"{path}: expected a list with one entry a frame, got {got}")
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
    known = places if np.isfinite(places).all() else None
    entries = Entries(np.array(frames), np.zeros(len(frames), dtype=np.int64), known)
    return picked(np.stack(joints), performer_rows(entries, performer, path))


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
