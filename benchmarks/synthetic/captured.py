"""Motion-capture skeletons as inputs of a simulated detector and camera.

The 14 joints that all captured skeletons share (EVAL_14) give the keypoints of a 2D detector. The
keypoints of face and feet, which captured skeletons define differently, are missing.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.camera.projection import intrinsics, project
from imocap_core.conventions import EVAL_14
from imocap_core.synthetic.cameras import CameraPlacement, look_at

JOINT_INDEX = {name: index for index, name in enumerate(EVAL_14)}
COCO18 = (
    *("nose", "neck", "right_shoulder", "right_elbow", "right_wrist"),
    *("left_shoulder", "left_elbow", "left_wrist", "right_hip", "right_knee", "right_ankle"),
    *("left_hip", "left_knee", "left_ankle", "right_eye", "left_eye", "right_ear", "left_ear"),
)
HIP_OUTWARD = 0.12  # of the hips' distance: detected hips lie further out (body/data/layouts.toml)
ANKLE_TO_FLOOR_AND_HEAD_TO_CROWN_M = 0.28
MARGIN = 0.06  # of the picture, free on each side of the performer
STEP_BACK = 1.05

# Four sides; focal lengths (over the picture's width) around what the pipeline assumes.
CAMERA_PLACEMENTS: tuple[CameraPlacement, ...] = (
    CameraPlacement(35.0, 4.0, 1.4, 1.0),
    CameraPlacement(125.0, 4.0, 1.0, 0.85),
    CameraPlacement(215.0, 4.0, 1.8, 1.15),
    CameraPlacement(305.0, 4.0, 1.2, 1.05),
)
# Between them, for actions of more videos.
FURTHER_PLACEMENTS: tuple[CameraPlacement, ...] = (
    CameraPlacement(80.0, 4.0, 1.5, 0.9),
    CameraPlacement(260.0, 4.0, 1.1, 1.1),
    CameraPlacement(350.0, 4.0, 1.7, 0.95),
    CameraPlacement(170.0, 4.0, 1.3, 1.0),
    CameraPlacement(55.0, 4.0, 2.0, 1.1),
    CameraPlacement(235.0, 4.0, 1.0, 0.9),
    CameraPlacement(325.0, 4.0, 1.4, 1.15),
    CameraPlacement(145.0, 4.0, 1.6, 0.85),
)


def hip_middle(joints_m: Float[np.ndarray, "... 14 3"]) -> Float[np.ndarray, "... 3"]:
    """Midpoint of the hips."""
    return joints_m[..., [JOINT_INDEX["left_hip"], JOINT_INDEX["right_hip"]], :].mean(axis=-2)


def coco18_points(joints_m: Float[np.ndarray, "... 14 3"]) -> Float[np.ndarray, "... 18 3"]:
    """COCO's 18 keypoints in space, from captured joints; NaN for the face."""
    points = np.full((*joints_m.shape[:-2], len(COCO18), 3), np.nan)
    for k, name in enumerate(COCO18):
        if name in JOINT_INDEX:
            points[..., k, :] = joints_m[..., JOINT_INDEX[name], :]
    left, right = (
        joints_m[..., JOINT_INDEX["left_hip"], :],
        joints_m[..., JOINT_INDEX["right_hip"], :],
    )
    points[..., COCO18.index("left_hip"), :] = left + HIP_OUTWARD * (left - right)
    points[..., COCO18.index("right_hip"), :] = right + HIP_OUTWARD * (right - left)
    shoulders = joints_m[..., [JOINT_INDEX["left_shoulder"], JOINT_INDEX["right_shoulder"]], :]
    points[..., COCO18.index("neck"), :] = shoulders.mean(axis=-2)
    return points


def stature_m(joints_m: Float[np.ndarray, "T 14 3"]) -> float:
    """Standing height of a performer: the bones from ankle to head, and the parts beyond them."""
    chain = [joints_m[:, JOINT_INDEX[f"left_{name}"]] for name in ("ankle", "knee", "hip")]
    chain += [
        hip_middle(joints_m),
        joints_m[:, JOINT_INDEX["neck"]],
        joints_m[:, JOINT_INDEX["head"]],
    ]
    bones = [np.linalg.norm(b - a, axis=-1) for a, b in pairwise(chain)]
    del bones[2]  # from the left hip to the middle of the hips is horizontal
    return float(np.median(np.sum(bones, axis=0))) + ANKLE_TO_FLOOR_AND_HEAD_TO_CROWN_M


def to_scene(joints_m: Float[np.ndarray, "T 14 3"]) -> tuple[Rotation, Float[np.ndarray, "3"]]:
    """Rotation about z and translation of a motion (z up) into the scene.

    In the scene the path is centred on the origin, the feet are on the floor, and the performer
    faces -y at first.
    """
    across = (joints_m[:, JOINT_INDEX["left_hip"]] - joints_m[:, JOINT_INDEX["right_hip"]])[
        : max(1, len(joints_m) // 4)
    ]
    x, y = across.mean(axis=0)[:2]
    turn = Rotation.from_rotvec([0.0, 0.0, -np.arctan2(y, x)])
    placed = turn.apply(joints_m.reshape(-1, 3)).reshape(joints_m.shape)
    middle = np.median(hip_middle(placed), axis=0)
    floor = np.quantile(placed[:, [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]], 2], 0.05)
    return turn, -np.array([middle[0], middle[1], floor - 0.08])


def place_camera(
    view: CameraPlacement, points_m: Float[np.ndarray, "T J 3"], size: tuple[int, int]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """K, R_cam_from_world and t of a static camera, moved back until all points are in view."""
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
