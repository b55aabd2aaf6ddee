"""The common points: detectors' keypoints by their place on the body, not by the detector's name.

A layout's columns map to the points at which they lie; points that it does not have stay empty.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import Keypoint, layout_keypoints
from imocap_core.conventions import SMPL_JOINTS, mirror_indices

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
SHOWN_BY = {"left_hip": "left_hip_seen", "right_hip": "right_hip_seen", "head": "nose"}
LEAST_POINTS = 6  # a layout that has fewer of them does not determine a pose


def columns_of(layout: str) -> tuple[list[int], list[int]]:
    """Columns of a layout and, for each, its row in `COMMON`.

    ValueError when the layout is unknown or has too few of the points (`can_lift`).
    """
    column_of = {
        _point(keypoint): column
        for column, keypoint in reversed(list(enumerate(layout_keypoints(layout))))
    }
    rows = [row for row, point in enumerate(COMMON) if point in column_of]
    if len(rows) < LEAST_POINTS:
        raise ValueError(
            f"layout {layout}: expected at least {LEAST_POINTS} of the lifter's points, got "
            f"{len(rows)}"
        )
    return [column_of[COMMON[row]] for row in rows], rows


def _point(keypoint: Keypoint) -> str:
    """The body point of a keypoint; MediaPipe's definitions of limb ends count as those ends."""
    return keypoint.point.removesuffix("_mediapipe").removesuffix("_blazepose")


def can_lift(layout: str) -> bool:
    """Whether a layout has enough of the common points."""
    points = {_point(keypoint) for keypoint in layout_keypoints(layout)}
    return sum(point in points for point in COMMON) >= LEAST_POINTS


def to_common(
    xy: Float[np.ndarray, "T K 2"], confidence: Float[np.ndarray, "T K"], layout: str
) -> tuple[Float[np.ndarray, "T 33 2"], Float[np.ndarray, "T 33"]]:
    """A detector's keypoints and confidences in the order of the common points.

    Missing points are 0 with confidence 0; confidences are clipped at 1.
    """
    columns, rows = columns_of(layout)
    points = np.zeros((len(xy), len(COMMON), 2))
    trust = np.zeros(points.shape[:2])
    visible = np.isfinite(xy[:, columns]).all(-1) & (confidence[:, columns] > 0)
    points[:, rows] = np.where(visible[..., None], xy[:, columns], 0.0)
    trust[:, rows] = np.where(visible, np.minimum(confidence[:, columns], 1.0), 0.0)
    return points, trust


def joints_seen(confidence: Float[np.ndarray, "T 33"], layout: str) -> Float[np.ndarray, "T 24"]:
    """How well each of SMPL's joints is seen: the confidence (`to_common`) of the point at it, or
    of the one that shows it; 1 where the layout has neither."""
    rows = set(columns_of(layout)[1])
    shown = np.ones((len(confidence), len(SMPL_JOINTS)))
    for joint, name in enumerate(SMPL_JOINTS):
        for point in (name, SHOWN_BY.get(name)):
            if point in COMMON and COMMON.index(point) in rows:
                shown[:, joint] = confidence[:, COMMON.index(point)]
                break
    return shown
