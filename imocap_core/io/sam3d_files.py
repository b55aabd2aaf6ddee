"""Files with what SAM 3D Body's estimator returns: MHR's 70 points of every person, by name.

The estimator gives a list of people per picture, each a dictionary with ``pred_keypoints_3d`` (70,
3) metres in camera axes, ``pred_keypoints_2d`` (70, 2) pixels, ``bbox`` x0, y0, x1, y1 in pixels,
and more. A file is a JSON, .npy or .pkl list with one entry per frame, each a list of people, one
person, or {``frame``: number, ``people``: list of people}.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.io.detectors.people import frame_number, type_name
from imocap_core.io.estimators.frame_lists import frame_entries, read_saved

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
        if isinstance(people, np.ndarray) and people.ndim:
            people = list(people)
        if not isinstance(people, list) or not all(isinstance(p, dict) for p in people):
            got = type_name(people)
            raise ValueError(f"{where}: expected a list of people with {POINTS_3D}, got {got}")
        yield frame, [(person, f"{where}[{i}]") for i, person in enumerate(people)]
