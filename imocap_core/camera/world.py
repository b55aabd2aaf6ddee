"""From camera axes to world axes, and a world aligned with its ground plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.rotations import unwrap

STILL_SHARE = 0.3  # of all feet in all frames: the slowest count as in contact with the ground
TRUST_M = 0.1  # feet that spread less than this hardly determine the ground; then posture decides
ROUNDS = 10
MAD_TO_SIGMA = 1.4826


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


def find_ground_alignment(
    feet: Sequence[Float[np.ndarray, "_ F 3"]],
    pelvis: Sequence[Float[np.ndarray, "_ 3"]],
    up_axis: str,
) -> GroundAlignment:
    """Ground plane estimation: the plane through the feet that are in contact with the ground.

    Args:
        feet: per video (T, F, 3) metres, the lowest joints of the legs; NaN where missing.
        pelvis: per video (T, 3) metres.
        up_axis: "y" or "z", the axis of the upright world that points up.

    The slowest feet count as in contact; a robust plane is fitted to them. Where they hardly
    spread, the mean direction from feet to pelvis decides.

    Raises:
        ValueError: another axis, or no foot in two consecutive frames.
    """
    if up_axis not in ("y", "z"):
        raise ValueError(f"up axis: expected y or z, got {up_axis!r}")
    contacts = _foot_contacts(feet)
    bodies = [np.asarray(p)[:, None] - f for p, f in zip(pelvis, feet, strict=True)]
    posture = np.nanmean(np.concatenate([b.reshape(-1, 3) for b in bodies]), axis=0)
    up, ground = _plane(contacts, posture / np.linalg.norm(posture))
    target = np.eye(3)[{"y": 1, "z": 2}[up_axis]]
    R_upright_from_world = _shortest_rotation(up, target)
    return GroundAlignment(R_upright_from_world, -(up @ ground) * target)


def _foot_contacts(feet: Sequence[Float[np.ndarray, "_ F 3"]]) -> Float[np.ndarray, "N 3"]:
    """Positions of the slowest feet of all videos."""
    middle, speed = [], []
    for f in feet:
        middle.append((0.5 * (f[1:] + f[:-1])).reshape(-1, 3))
        speed.append(np.linalg.norm(f[1:] - f[:-1], axis=-1).ravel())
    points, speeds = np.concatenate(middle), np.concatenate(speed)
    valid = np.isfinite(speeds)
    if not valid.any():
        raise ValueError("no foot in two consecutive frames, so the ground can't be estimated")
    return points[valid & (speeds <= np.quantile(speeds[valid], STILL_SHARE))]


def _plane(
    points: Float[np.ndarray, "N 3"], posture: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Normal (up) and a point of the plane fitted to `points`, near `posture`.

    Robust least squares (Cauchy weights) of the heights; a ridge term keeps the slope relative to
    `posture` small, as strong as feet that spread over TRUST_M.
    """
    weights = np.ones(len(points))
    up, centre = posture, np.median(points, axis=0)
    for _ in range(ROUNDS):
        east, north = _perpendicular(up)
        centre = np.average(points, axis=0, weights=weights)
        flat = (points - centre) @ np.stack([east, north], axis=1)
        height = (points - centre) @ up
        lean = np.array([posture @ east, posture @ north]) / max(posture @ up, 1e-3)
        ridge = weights.sum() * TRUST_M**2 * 0.1
        normal = (weights[:, None] * flat).T @ flat + ridge * np.eye(2)
        slope = np.linalg.solve(normal, ridge * lean - flat.T @ (weights * height))
        up = up + slope[0] * east + slope[1] * north
        up /= np.linalg.norm(up)
        height = (points - centre) @ up
        scale = max(MAD_TO_SIGMA * float(np.median(np.abs(height - np.median(height)))), 0.01)
        weights = 1.0 / (1.0 + ((height - np.median(height)) / (2 * scale)) ** 2)
    return up, centre


def _perpendicular(
    up: Float[np.ndarray, "3"],
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Two unit vectors perpendicular to `up` and to each other."""
    aside = np.eye(3)[int(np.argmin(np.abs(up)))]
    east = np.cross(up, aside)
    east /= np.linalg.norm(east)
    return east, np.cross(up, east)


def _shortest_rotation(
    start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """The rotation by the smallest angle that takes one unit vector to another."""
    axis = np.cross(start, end)
    sine, cosine = float(np.linalg.norm(axis)), float(start @ end)
    if sine < 1e-12:
        axis, sine = _perpendicular(start)[0], 1.0
    angle = np.arctan2(np.linalg.norm(np.cross(start, end)), cosine)
    return Rotation.from_rotvec(axis / sine * angle).as_matrix()
