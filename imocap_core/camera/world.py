"""From camera axes to world axes, and from a world to another one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.rotations import unwrap


@dataclass(frozen=True)
class BodyMotion:
    """The motion of one video's body, in the axes of a camera or of the world.

    theta: axis-angle pose, radians, the root first. trans: SMPL's translation, metres. joints:
    metres, the pelvis first.
    """

    theta: Float[np.ndarray, "T P"]
    trans: Float[np.ndarray, "T 3"]
    joints: Float[np.ndarray, "T J 3"]


@dataclass(frozen=True)
class Extrinsics:
    """Camera pose: x_cam = R x_world + t, t in metres."""

    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class GroundAlignment:
    """Rigid transform to an upright world, one axis up and the ground at 0:
    x_upright = R_upright_from_world x_world + t, metres."""

    R_upright_from_world: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]


def to_world(motion: BodyMotion, camera: Extrinsics) -> BodyMotion:
    """A motion in camera axes, in world axes: x_world = R^T (x_cam - t).

    Of theta only the root's rotation changes; its axis-angle vector is unwrapped over time. trans
    is not a point of the body but a shift relative to the rest pose's pelvis, which does not
    change: pelvis = rest pelvis + trans.
    """
    R_world_from_cam = camera.R.T
    root = Rotation.from_matrix(R_world_from_cam) * Rotation.from_rotvec(motion.theta[:, :3])
    rest_pelvis = motion.joints[:, 0] - motion.trans
    joints = (motion.joints - camera.t) @ camera.R
    root_path = unwrap(torch.as_tensor(root.as_rotvec())).numpy()
    theta = np.concatenate([root_path, motion.theta[:, 3:]], axis=1)
    return BodyMotion(theta, joints[:, 0] - rest_pelvis, joints)


def align_motion_to_ground(motion: BodyMotion, ground: GroundAlignment) -> BodyMotion:
    """A motion in world axes, in the upright world."""
    R_world_from_upright = ground.R_upright_from_world.T
    return to_world(motion, Extrinsics(R_world_from_upright, -R_world_from_upright @ ground.t))


def align_camera_to_ground(camera: Extrinsics, ground: GroundAlignment) -> Extrinsics:
    """The pose of a camera relative to the upright world."""
    R_cam_from_upright = camera.R @ ground.R_upright_from_world.T
    return Extrinsics(R_cam_from_upright, camera.t - R_cam_from_upright @ ground.t)


def y_up_axes(up: str) -> Float[np.ndarray, "3 3"]:
    """Rotation from a world whose y or z points up to one whose y does: (x, y, z) to (x, z, -y)."""
    return (
        np.eye(3) if up == "y" else np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    )


def on_floor(points: Float[np.ndarray, "... 3"], up: str) -> Float[np.ndarray, "... 3"]:
    """Points projected to the floor of a levelled world whose y or z points up."""
    return points * np.where(np.array(["x", "y", "z"]) == up, 0.0, 1.0)


def heading(R: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3 3"]:
    """Twist of rotations over time about y, which points up; it does not jump."""
    angle = np.unwrap(2 * np.arctan2(R[:, 0, 2] - R[:, 2, 0], 1 + np.trace(R, axis1=1, axis2=2)))
    return np.asarray(Rotation.from_rotvec(angle[:, None] * np.array([0.0, 1.0, 0.0])).as_matrix())
