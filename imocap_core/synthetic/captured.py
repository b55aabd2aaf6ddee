"""Captured skeletons as a detector and a camera see them.

Motion capture knows 14 joints that every skeleton shares (EVAL_14); what a 2D detector marks is
made of them. Points of face and feet, which the captured skeletons place elsewhere, stay unseen.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from imocap_core.camera.projection import intrinsics, project
from imocap_core.conventions import EVAL_14
from imocap_core.render.arrays import Floats
from imocap_core.synthetic.cameras import Viewpoint, look_at

AT = {name: index for index, name in enumerate(EVAL_14)}
COCO18 = (
    *("nose", "neck", "right_shoulder", "right_elbow", "right_wrist"),
    *("left_shoulder", "left_elbow", "left_wrist", "right_hip", "right_knee", "right_ankle"),
    *("left_hip", "left_knee", "left_ankle", "right_eye", "left_eye", "right_ear", "left_ear"),
)
HIP_OUT = 0.12  # seen hips stand out by this share of the hips' distance (body/data/layouts.toml)
ANKLE_TO_FLOOR_AND_HEAD_TO_CROWN_M = 0.28
MARGIN = 0.06  # of the picture, kept free around the performer
STEP_BACK = 1.05

# Four sides; focal lengths (over the picture's width) around what the pipeline assumes.
VIEWPOINTS: tuple[Viewpoint, ...] = (
    Viewpoint(35.0, 4.0, 1.4, 1.0),
    Viewpoint(125.0, 4.0, 1.0, 0.85),
    Viewpoint(215.0, 4.0, 1.8, 1.15),
    Viewpoint(305.0, 4.0, 1.2, 1.05),
)


def hip_middle(joints_m: Floats) -> Floats:
    """(..., 3) middle of the hips of joints (..., 14, 3)."""
    middle: Floats = joints_m[..., [AT["left_hip"], AT["right_hip"]], :].mean(axis=-2)
    return middle


def coco18_points(joints_m: Floats) -> Floats:
    """What COCO's 18 keypoints mark, (..., 18, 3), of joints (..., 14, 3); NaN for the face."""
    points = np.full((*joints_m.shape[:-2], len(COCO18), 3), np.nan)
    for k, name in enumerate(COCO18):
        if name in AT:
            points[..., k, :] = joints_m[..., AT[name], :]
    left, right = joints_m[..., AT["left_hip"], :], joints_m[..., AT["right_hip"], :]
    points[..., COCO18.index("left_hip"), :] = left + HIP_OUT * (left - right)
    points[..., COCO18.index("right_hip"), :] = right + HIP_OUT * (right - left)
    shoulders = joints_m[..., [AT["left_shoulder"], AT["right_shoulder"]], :]
    points[..., COCO18.index("neck"), :] = shoulders.mean(axis=-2)
    return points


def stature_m(joints_m: Floats) -> float:
    """Standing height of a performer: the chain from ankle to head and what lies beyond it."""
    chain = [joints_m[:, AT[f"left_{name}"]] for name in ("ankle", "knee", "hip")]
    chain += [hip_middle(joints_m), joints_m[:, AT["neck"]], joints_m[:, AT["head"]]]
    bones = [np.linalg.norm(b - a, axis=-1) for a, b in pairwise(chain)]
    del bones[2]  # from the left hip to the middle is no height
    return float(np.median(np.sum(bones, axis=0))) + ANKLE_TO_FLOOR_AND_HEAD_TO_CROWN_M


def to_stage(joints_m: Floats) -> tuple[Rotation, Floats]:
    """The turn about z and the shift (3,) that set a performance (T, 14, 3), z up, on the stage:
    its path around the origin, its feet on the floor, its performer facing -y at first."""
    across = (joints_m[:, AT["left_hip"]] - joints_m[:, AT["right_hip"]])[
        : max(1, len(joints_m) // 4)
    ]
    x, y = across.mean(axis=0)[:2]
    turn = Rotation.from_rotvec([0.0, 0.0, -np.arctan2(y, x)])
    placed = turn.apply(joints_m.reshape(-1, 3)).reshape(joints_m.shape)
    middle = np.median(hip_middle(placed), axis=0)
    floor = np.quantile(placed[:, [AT["left_ankle"], AT["right_ankle"]], 2], 0.05)
    return turn, -np.array([middle[0], middle[1], floor - 0.08])


def place_camera(
    view: Viewpoint, points_m: Floats, size: tuple[int, int]
) -> tuple[Floats, Floats, Floats]:
    """K (3, 3), R_cam_from_world (3, 3), t (3,) of a fixed camera at a viewpoint, moved back until
    it sees all of points (T, J, 3)."""
    K = intrinsics(view.focal_per_width * max(size), size)
    azimuth = np.deg2rad(view.azimuth_deg)
    outward = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    target = np.array([*np.median(points_m[..., :2].reshape(-1, 2), axis=0), view.aim_height_m])
    flat = points_m.reshape(-1, 3)
    distance = view.distance_m
    while True:
        centre = target * (1, 1, 0) + distance * outward + (0, 0, view.height_m)
        R = look_at(centre, target, view.roll_deg, np.zeros(2))
        t = -R @ centre
        if ((flat @ R.T + t)[:, 2] > 0.5).all():
            share = project(flat, K, R, t) / np.array(size)
            if share.min() > MARGIN and share.max() < 1 - MARGIN:
                return K, R, t
        distance *= STEP_BACK
