"""From the covariance of the unknowns to that of the joints, through the kinematic Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.kinematics import Body
from imocap_core.motion.state import MotionState

HIPS = [SMPL_JOINTS.index("left_hip"), SMPL_JOINTS.index("right_hip")]


@dataclass(frozen=True)
class JointCovariance:
    """Covariance of joints about the middle of the hips, in a motion's axes.

    Attributes:
        given_shape: (T, 24, 3, 3) m^2 if the shape were known.
        by_shape: (T, 24, 3, 10) how the joints follow the shape.
    """

    given_shape: Float[Tensor, "T 24 3 3"]
    by_shape: Float[Tensor, "T 24 3 10"]

    def covariance(self, shape: Float[Tensor, "10 10"]) -> Float[Tensor, "T 24 3 3"]:
        """Covariance in m^2 when the shape has this covariance."""
        return self.given_shape + self.by_shape @ shape @ self.by_shape.mT


def joint_covariance(
    body: Body,
    motion: MotionState,
    frames: Float[Tensor, "T 75 75"],
    response: Float[Tensor, "T 75 10"],
) -> JointCovariance:
    """Joints' covariance from that of a motion's increments.

    Args:
        motion: a batch of 1; frames: covariance of its increments, the shape known.
        response: with -response, frames follow the shape.
    """
    by_frame, by_shape = joint_jacobian(body, motion)
    half = (by_frame.flatten(1, 2) @ frames).unflatten(1, by_frame.shape[1:3])
    follow = torch.einsum("tjxn,tni->tjxi", by_frame, response)
    return JointCovariance(half @ by_frame.mT, by_shape - follow)


def joint_jacobian(
    body: Body, motion: MotionState
) -> tuple[Float[Tensor, "T 24 3 75"], Float[Tensor, "T 24 3 10"]]:
    """Derivatives of joints about the middle of the hips by a motion's increments and its shape."""
    points = body.derivatives(body.joints, motion)
    assert points.d_pose is not None
    assert points.d_beta is not None
    d_pose, d_beta = points.d_pose[0], points.d_beta[0]
    by_frame = torch.cat([d_pose, torch.zeros_like(d_pose[..., :3])], -1)
    return _about_hips(by_frame), _about_hips(d_beta)


def _about_hips(rows: Tensor) -> Tensor:
    return rows - rows[:, HIPS].mean(1, keepdim=True)
