"""The common points: what detectors mark, by the body's point, not by the detector's name for it.

A layout's columns go to the points they sit at; points that it does not have stay empty.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imocap_core.body.layouts import Keypoint, layout_keypoints
from imocap_core.conventions import mirror_indices

COMMON: tuple[str, ...] = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear"),
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    *("left_hip_seen", "right_hip_seen"),
    *("left_knee", "right_knee", "left_ankle", "right_ankle"),
    *("left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe"),
    *("left_heel", "right_heel"),
    *("shoulder_middle", "mid_hip", "head_top", "upper_neck"),
    *("left_hip", "right_hip", "pelvis", "spine2", "neck", "head"),
)
MIRROR = mirror_indices(COMMON)
LEAST_POINTS = 6  # a layout that has fewer of them says too little of a pose

Array = NDArray[np.float64]


def columns_of(layout: str) -> tuple[list[int], list[int]]:
    """Columns of a layout and, for each, its row among `COMMON`.

    ValueError when the layout is not known or has too few of the points (`can_lift`).
    """
    at = {_point(k): column for column, k in reversed(list(enumerate(layout_keypoints(layout))))}
    rows = [row for row, point in enumerate(COMMON) if point in at]
    if len(rows) < LEAST_POINTS:
        raise ValueError(
            f"layout {layout}: expected at least {LEAST_POINTS} of the lifter's points, got "
            f"{len(rows)}"
        )
    return [at[COMMON[row]] for row in rows], rows


def _point(keypoint: Keypoint) -> str:
    """Where it sits; a detector's own idea of a limb's end is that end."""
    return keypoint.point.removesuffix("_mediapipe")


def can_lift(layout: str) -> bool:
    """Whether a layout has enough of the points."""
    here = {_point(keypoint) for keypoint in layout_keypoints(layout)}
    return sum(point in here for point in COMMON) >= LEAST_POINTS


def to_common(xy: Array, confidence: Array, layout: str) -> tuple[Array, Array]:
    """A detector's (T, K, 2) and (T, K) as the common points' (T, 33, 2) and (T, 33).

    Missing points are 0 with confidence 0; confidences are cut off at 1.
    """
    columns, rows = columns_of(layout)
    points = np.zeros((len(xy), len(COMMON), 2))
    trust = np.zeros(points.shape[:2])
    seen = np.isfinite(xy[:, columns]).all(-1) & (confidence[:, columns] > 0)
    points[:, rows] = np.where(seen[..., None], xy[:, columns], 0.0)
    trust[:, rows] = np.where(seen, np.minimum(confidence[:, columns], 1.0), 0.0)
    return points, trust
