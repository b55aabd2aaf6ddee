"""Where cameras stand about the performer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.motion.kinematics import Body
from imocap_core.motion.posterior.joint_covariance import HIPS
from imocap_core.motion.state import MotionState

Array = NDArray[np.float64]
LEAST_FACING = 0.5  # length of the mean facing below which the performer turns round


@dataclass(frozen=True)
class Stage:
    """Where the performer stands: axes of azimuth in the world, unit vectors and metres.

    Azimuth 0 is in front of the performer (of the first camera where the performer turns round),
    90 on the performer's left.
    """

    middle: Array
    front: Array
    left: Array
    up: Array
    by_performer: bool

    def outward(self, azimuth_deg: float) -> Array:
        """(3,) from the performer to a camera at this azimuth."""
        a = np.radians(azimuth_deg)
        return np.cos(a) * self.front + np.sin(a) * self.left

    def azimuth_deg(self, towards_performer: Array) -> float:
        """Azimuth, 0 to 360, of a camera that looks along ``towards_performer`` (3,)."""
        back = -towards_performer
        return float(np.degrees(np.arctan2(back @ self.left, back @ self.front)) % 360)


def stage_of(body: Body, motion: MotionState, R_cam_from_world: Array, ahead: Array) -> Stage:
    """The stage of a motion (batch of 1, world axes).

    Args:
        R_cam_from_world: (M, 3, 3); their mean upright is the world's (cameras are held upright).
        ahead: (3,) unit vector in which the first camera looks.
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
    return Stage(joints[:, 0].mean(0), front, np.cross(up, front), up, by_performer)
