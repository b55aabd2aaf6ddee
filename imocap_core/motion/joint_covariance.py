"""From the covariance of the unknowns to that of the joints, through the kinematic Jacobian."""

import torch
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.kinematics import Body
from imocap_core.motion.state import MotionState

HIPS = [SMPL_JOINTS.index("left_hip"), SMPL_JOINTS.index("right_hip")]


def joint_covariance(
    body: Body, motion: MotionState, frames: Tensor, response: Tensor, shape: Tensor
) -> Tensor:
    """(T, 24, 3, 3) m^2, joints about the middle of the hips, in the motion's axes.

    Args:
        motion: a batch of 1; frames: (T, 75, 75) covariance of its increments, the shape known.
        response: (T, 75, 10) with -response, frames follow the shape; shape: (10, 10) covariance.
    """
    by_frame, by_shape = joint_jacobian(body, motion)
    by_shape = by_shape - torch.einsum("tjxn,tni->tjxi", by_frame, response)
    return _carried(by_frame, frames) + _carried(by_shape, shape.expand(len(frames), -1, -1))


def joint_jacobian(body: Body, motion: MotionState) -> tuple[Tensor, Tensor]:
    """(T, 24, 3, 75) and (T, 24, 3, 10): joints about the middle of the hips by a motion's
    increments and by its shape (batch of 1)."""
    points = body.derivatives(body.joints, motion)
    assert points.d_pose is not None
    assert points.d_beta is not None
    d_pose, d_beta = points.d_pose[0], points.d_beta[0]
    by_frame = torch.cat([d_pose, torch.zeros_like(d_pose[..., :3])], -1)
    return _about_hips(by_frame), _about_hips(d_beta)


def _about_hips(rows: Tensor) -> Tensor:
    return rows - rows[:, HIPS].mean(1, keepdim=True)


def _carried(rows: Tensor, covariance: Tensor) -> Tensor:
    """(T, J, 3, 3): J C J^T of each joint."""
    half = (rows.flatten(1, 2) @ covariance).unflatten(1, rows.shape[1:3])
    return half @ rows.mT
