"""Estimators of 3D joints: joints_npz, and SAM 3D Body as its users saved it.

SAM 3D Body: a list with one entry per frame, each a list of people, one person, or {``frame``:
number, ``people``: list of people}; a person is a dictionary with ``pred_keypoints_3d`` (70, 3)
metres in camera axes, ``pred_keypoints_2d`` (70, 2) pixels, ``bbox`` x0, y0, x1, y1 in pixels, and
more. Or an npz with ``pred_keypoints_3d`` (T, 70, 3) of one person and, optionally, ``frames``
(T,). The 70 points are MHR's; those that are joints of SMPL are used by the fits. MHR's parameters
are of its own body and not used: the joints' distances tell the size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from imocap_core.io.npz import load_arrays, names, numbers, rows_for_frames
from imocap_core.io.readers.estimates import (
    PerformerBoxes,
    PersonInFrame,
    field,
    frame_entries,
    of_performer,
    read_saved,
)
from imocap_core.io.readers.people import frame_number, listed


@dataclass(frozen=True)
class JointsEstimate:
    """Joints in metres, camera axes, root-relative or not; NaN where missing."""

    joints: Float[np.ndarray, "T J 3"]
    joint_names: tuple[str, ...]


def read_joints_npz(path: Path, used_frames: Int[np.ndarray, " T"]) -> JointsEstimate:
    """The estimate at the used source frames.

    The file has ``joints`` (N, J, 3), ``joint_names`` (J,) and, optionally, ``frames`` (N,);
    see `rows_for_frames` for files without. ValueError names file, array, expected and got.
    """
    arrays = load_arrays(path)
    joints = numbers(arrays, "joints", ("T", "J", 3), path)
    joint_names = names(arrays, "joint_names", joints.shape[1], path)
    rows = rows_for_frames(arrays, len(joints), used_frames, path)
    return JointsEstimate(joints[rows], joint_names)


POINTS_3D, POINTS_2D = "pred_keypoints_3d", "pred_keypoints_2d"


def _hand(side: str) -> tuple[str, ...]:
    """MHR's 20 points of a hand, tips first, under SMPL+H's names, and the wrist."""
    fingers = ("thumb", "index", "middle", "ring", "pinky")
    points = [f"{side}_{f}{n}" for f in fingers for n in ("_tip", 3, 2, 1)]
    return (*points, f"{side}_wrist")


# MHR's 70 keypoints in their order, named as in this project where it has them.
NAMES: tuple[str, ...] = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear"),
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_hip", "right_hip"),
    *("left_knee", "right_knee", "left_ankle", "right_ankle"),
    *("left_big_toe", "left_small_toe", "left_heel"),
    *("right_big_toe", "right_small_toe", "right_heel"),
    *_hand("right"),
    *_hand("left"),
    *("left_olecranon", "right_olecranon", "left_cubital_fossa", "right_cubital_fossa"),
    *("left_acromion", "right_acromion", "neck"),
)


def saved_people(path: Path) -> Iterator[tuple[int, list[tuple[dict[str, Any], str]]]]:
    """Per frame its number, and its people with their places in the file.

    ValueError names file, frame, expected and got.
    """
    for n, entry in enumerate(frame_entries(read_saved(path), path)):
        where, frame, people = f"{path}: [{n}]", n, entry
        if isinstance(entry, dict) and not {POINTS_3D, POINTS_2D} & set(entry):
            frame = frame_number(entry.get("frame", n), f"{where}: frame")
            people = entry.get("people")
        elif isinstance(entry, dict):
            people = [entry]
        people = listed(people, where, f"a list of people with {POINTS_3D}")
        if not all(isinstance(p, dict) for p in people):
            raise ValueError(f"{where}: expected a list of people with {POINTS_3D}, got a list")
        yield frame, [(person, f"{where}[{i}]") for i, person in enumerate(people)]


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
