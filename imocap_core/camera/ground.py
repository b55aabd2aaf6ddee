"""Ground plane estimation, and the one world that is level with it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.camera.gravity import FilmedBody, estimate_up
from imocap_core.camera.ground_plane import Ground
from imocap_core.camera.tilt_evidence import (
    BALLS,
    PART_RADII_M,
    PARTS,
    LevelPrior,
    planted_feet,
    planted_weight,
    weighted_quantile,
)
from imocap_core.camera.world import GroundAlignment

BALL_ABOVE_SOLE_M = 0.027  # SMPL's foot joint above the sole, in the free body at rest
HEIGHT_ROUNDS, HEIGHT_SCALE_M = 5, 0.05
LEAST_HEIGHT_SD_M = 0.01
PLANTED_QUANTILE = 0.4  # of slow feet: the others may be held still above the ground
FEET_CARRY_M = 0.15  # above the lowest part: higher feet do not tell the floor
LEAST_SIDEWAYS = 0.1  # length of a camera's horizontal direction below which it looks up or down
Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def estimate_ground(bodies: Sequence[FilmedBody], prior: LevelPrior) -> Ground:
    """The ground under bodies in one world, and its uncertainty.

    Without a frame that has all joints: up by the cameras, the height unknown (NaN).
    """
    estimate = estimate_up(bodies, prior)
    whole = [b.joints[np.isfinite(b.joints).all(axis=(1, 2))] for b in bodies]
    rows = [
        _standing_on(x, b.fps, estimate.up) for x, b in zip(whole, bodies, strict=True) if len(x)
    ]
    if not rows:
        return Ground(estimate.up, np.zeros(3), estimate.sd_deg, float("nan"))
    soles, planted = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    height, height_sd_m = _height(soles, planted, len(rows))
    middle = np.concatenate(whole)[:, 0].mean(axis=0)
    origin = middle + (height - middle @ estimate.up) * estimate.up
    return Ground(estimate.up, origin, estimate.sd_deg, 1000 * height_sd_m)


def upright_alignment(
    ground: Ground, R_cam_from_world: Float[np.ndarray, "3 3"], up_axis: str
) -> GroundAlignment:
    """From a world to the one that is level with its ground, with y or z up.

    Its origin is the ground's. y up: a camera, that of the reference video, looks along -z, its
    right is x. z up is the same world turned by a quarter about x (x, -z, y): it looks along y.

    Raises:
        ValueError: another axis.
    """
    if up_axis not in ("y", "z"):
        raise ValueError(f"up axis: expected y or z, got {up_axis!r}")
    ahead = R_cam_from_world[2]
    if np.linalg.norm(np.cross(ahead, ground.up)) < LEAST_SIDEWAYS:
        ahead = R_cam_from_world[1] * np.sign(ahead @ ground.up)  # looking down: the picture's top
    right = np.cross(ahead, ground.up)
    right /= np.linalg.norm(right)
    R = np.stack([right, ground.up, np.cross(right, ground.up)])
    if up_axis == "z":
        R = Z_UP_FROM_Y_UP @ R
    return GroundAlignment(R, -R @ ground.origin)


def sole_depths_mm(joints: Float[np.ndarray, "T 24 3"], ground: Ground) -> Float[np.ndarray, " T"]:
    """How far the lower sole is below the ground, millimetres; 0 above it."""
    return np.asarray(1000 * np.maximum(-sole_heights_m(joints, ground), 0.0))


def sole_heights_m(joints: Float[np.ndarray, "T 24 3"], ground: Ground) -> Float[np.ndarray, " T"]:
    """Height of the lower sole above the ground."""
    return np.asarray((ground.height_m(joints[:, BALLS]) - BALL_ABOVE_SOLE_M).min(axis=1))


def _standing_on(
    joints: Float[np.ndarray, "T 24 3"], fps: float, up: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Heights of planted soles, and their weights; of the lowest part where no foot is as low."""
    parts = joints[:, PARTS] @ up - PART_RADII_M
    lowest = parts.argmin(axis=1)
    soles = (joints[:, BALLS] @ up).min(axis=1) - BALL_ABOVE_SOLE_M
    on_feet = soles < parts.min(axis=1) + FEET_CARRY_M
    heights, weights = [parts.min(axis=1)[~on_feet]], []
    steps = np.diff(joints[:, PARTS], axis=0, append=joints[-1:, PARTS])
    speed = fps * np.linalg.norm(steps, axis=-1)
    weights.append(planted_weight(speed[np.arange(len(joints)), lowest])[~on_feet])
    if on_feet.any():
        feet, planted = planted_feet(joints[on_feet], fps)
        heights.append(feet @ up - BALL_ABOVE_SOLE_M)
        weights.append(planted)
    return np.concatenate(heights), np.concatenate(weights)


def _height(
    heights: Float[np.ndarray, " N"], planted: Float[np.ndarray, " N"], videos: int
) -> tuple[float, float]:
    """Height of planted feet, and its standard deviation, by reweighted least squares (Cauchy).

    Errors of one video are one error: it counts once.
    """
    height = float(weighted_quantile(heights[None], planted, PLANTED_QUANTILE)[0])
    weight = planted
    for _ in range(HEIGHT_ROUNDS):
        weight = planted / (1.0 + ((heights - height) / HEIGHT_SCALE_M) ** 2)
        height = float(np.average(heights, weights=weight))
    variance = float(np.average((heights - height) ** 2, weights=weight))
    return height, max(float(np.sqrt(variance / videos)), LEAST_HEIGHT_SD_M)
