"""Azimuths of cameras about the performer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.motion.kinematics import Body
from imocap_core.motion.posterior.joint_covariance import HIPS
from imocap_core.motion.state import MotionState

LEAST_FACING = 0.5  # length of the mean facing below which the performer turns round


@dataclass(frozen=True)
class PerformerAxes:
    """The performer's place and axes in the world: unit vectors and metres.

    Azimuth 0 is in front of the performer (of the first camera where the performer turns round),
    90 on the performer's left.
    """

    middle: Float[np.ndarray, "3"]
    front: Float[np.ndarray, "3"]
    left: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    by_performer: bool

    def outward(self, azimuth_deg: float) -> Float[np.ndarray, "3"]:
        """Unit vector from the performer to a camera at this azimuth."""
        a = np.radians(azimuth_deg)
        return np.cos(a) * self.front + np.sin(a) * self.left

    def azimuth_deg(self, towards_performer: Float[np.ndarray, "3"]) -> float:
        """Azimuth, 0 to 360, of a camera that looks along ``towards_performer``."""
        back = -towards_performer
        return float(np.degrees(np.arctan2(back @ self.left, back @ self.front)) % 360)


def performer_axes(
    body: Body,
    motion: MotionState,
    R_cam_from_world: Float[np.ndarray, "M 3 3"],
    ahead: Float[np.ndarray, "3"],
) -> PerformerAxes:
    """The performer's axes from a motion (batch of 1, world axes).

    Args:
        R_cam_from_world: their mean upright is the world's (cameras are held upright).
        ahead: unit vector in which the first camera looks.
    """
    joints = body.positions(body.joints, motion).xyz[0].cpu().numpy()
    up = -R_cam_from_world[:, 1].mean(0)
    up /= np.linalg.norm(up)
    left = joints[:, HIPS[0]] - joints[:, HIPS[1]]
    facing = np.cross(left, up)
    facing /= np.linalg.norm(facing, axis=-1, keepdims=True) + 1e-9
    front = facing.mean(0)
    by_performer = bool(np.linalg.norm(front) > LEAST_FACING)
    if not by_performer:
        front = -ahead
    front = front - (front @ up) * up
    front /= np.linalg.norm(front)
    return PerformerAxes(joints[:, 0].mean(0), front, np.cross(up, front), up, by_performer)
