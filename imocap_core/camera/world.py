"""From one camera's axes to the world's, and a world that stands level on its ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from imocap_core.rotations import unwrap

Array = NDArray[np.float64]

STILL_SHARE = 0.3  # of all feet in all frames, the slowest are taken to stand
TRUST_M = 0.1  # feet spread less than this say little about the ground; the posture decides then
ROUNDS = 10
MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True)
class Motion:
    """One video's body: theta (T, 72) axis-angle radians, trans (T, 3) as in smplx, metres,
    joints (T, J, 3) metres with the pelvis first."""

    theta: Array
    trans: Array
    joints: Array


@dataclass(frozen=True)
class Extrinsics:
    """x_cam = R x_world + t, t in metres."""

    R: Array
    t: Array


@dataclass(frozen=True)
class Level:
    """x_level = R_level_from_world x_world + t: one axis up, the ground at 0."""

    R_level_from_world: Array
    t: Array


def to_world(motion: Motion, camera: Extrinsics) -> Motion:
    """A body in a camera's axes, in world axes: x_world = R^T (x_cam - t).

    theta turns by its first joint only, whose axis-angle vector stays on one branch over time.
    trans is not a point of the body but the shift about the rest pelvis, which stays where it is:
    pelvis = rest pelvis + trans.
    """
    R_world_from_cam = camera.R.T
    root = Rotation.from_matrix(R_world_from_cam) * Rotation.from_rotvec(motion.theta[:, :3])
    rest_pelvis = motion.joints[:, 0] - motion.trans
    joints = (motion.joints - camera.t) @ camera.R
    root_path = unwrap(torch.as_tensor(root.as_rotvec())).numpy()
    theta = np.concatenate([root_path, motion.theta[:, 3:]], axis=1)
    return Motion(theta, joints[:, 0] - rest_pelvis, joints)


def level_motion(motion: Motion, level: Level) -> Motion:
    """A body in world axes, in level axes."""
    R_world_from_level = level.R_level_from_world.T
    return to_world(motion, Extrinsics(R_world_from_level, -R_world_from_level @ level.t))


def level_camera(camera: Extrinsics, level: Level) -> Extrinsics:
    """The same camera, from the level world."""
    R_cam_from_level = camera.R @ level.R_level_from_world.T
    return Extrinsics(R_cam_from_level, camera.t - R_cam_from_level @ level.t)


def find_level(feet: list[Array], pelvis: list[Array], up_axis: str) -> Level:
    """The ground under some performances in one world.

    Args:
        feet: per video (T, F, 3) metres, the lowest joints of the legs; NaN where missing.
        pelvis: per video (T, 3) metres.
        up_axis: "y" or "z", the axis that shall point up.

    Standing feet (the slowest ones) lie on the ground: a robust plane through them. Where they
    hardly spread, the mean direction from feet to pelvis decides.

    ValueError for another axis, or when no foot is seen in two frames on end.
    """
    if up_axis not in ("y", "z"):
        raise ValueError(f"up axis: expected y or z, got {up_axis!r}")
    standing = _standing(feet)
    bodies = [np.asarray(p)[:, None] - f for p, f in zip(pelvis, feet, strict=True)]
    posture = np.nanmean(np.concatenate([b.reshape(-1, 3) for b in bodies]), axis=0)
    up, ground = _plane(standing, posture / np.linalg.norm(posture))
    target = np.eye(3)[{"y": 1, "z": 2}[up_axis]]
    R_level_from_world = _shortest_turn(up, target)
    return Level(R_level_from_world, -(up @ ground) * target)


def _standing(feet: list[Array]) -> Array:
    """(N, 3) positions of the slowest feet of all videos."""
    middle, speed = [], []
    for f in feet:
        middle.append((0.5 * (f[1:] + f[:-1])).reshape(-1, 3))
        speed.append(np.linalg.norm(f[1:] - f[:-1], axis=-1).ravel())
    points, speeds = np.concatenate(middle), np.concatenate(speed)
    seen = np.isfinite(speeds)
    if not seen.any():
        raise ValueError("no foot is seen in two frames on end, so the ground can't be found")
    return points[seen & (speeds <= np.quantile(speeds[seen], STILL_SHARE))]


def _plane(points: Array, posture: Array) -> tuple[Array, Array]:
    """Up direction (3,) and a point (3,) of a plane through `points`, near `posture`.

    Robust least squares (Cauchy weights) of the heights, with the slope against `posture` held
    back as if by feet that spread over TRUST_M.
    """
    weights = np.ones(len(points))
    up, centre = posture, np.median(points, axis=0)
    for _ in range(ROUNDS):
        east, north = _across(up)
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


def _across(up: Array) -> tuple[Array, Array]:
    """Two unit vectors at right angles to `up` and to each other."""
    aside = np.eye(3)[int(np.argmin(np.abs(up)))]
    east = np.cross(up, aside)
    east /= np.linalg.norm(east)
    return east, np.cross(up, east)


def _shortest_turn(start: Array, end: Array) -> Array:
    """The rotation matrix (3, 3) by the smallest angle that takes one unit vector to another."""
    axis = np.cross(start, end)
    sine, cosine = float(np.linalg.norm(axis)), float(start @ end)
    if sine < 1e-12:
        axis, sine = _across(start)[0], 1.0
    angle = np.arctan2(np.linalg.norm(np.cross(start, end)), cosine)
    return Rotation.from_rotvec(axis / sine * angle).as_matrix()
