"""From the covariance of the unknowns to that of joints and rotations, through their Jacobians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.kinematics import Body
from imocap_core.motion.state import MotionState

HIPS = [SMPL_JOINTS.index("left_hip"), SMPL_JOINTS.index("right_hip")]


@dataclass(frozen=True)
class VectorCovariance:
    """Covariance of K vectors that follow a motion's increments and its shape.

    Attributes:
        given_shape: (T, K, 3, 3) if the shape were known.
        by_shape: (T, K, 3, 10) how the vectors follow the shape.
    """

    given_shape: Float[Tensor, "T K 3 3"]
    by_shape: Float[Tensor, "T K 3 10"]

    def covariance(self, shape: Float[Tensor, "10 10"]) -> Float[Tensor, "T K 3 3"]:
        """Covariance when the shape has this covariance."""
        return self.given_shape + self.by_shape @ shape @ self.by_shape.mT


def joined(parts: Sequence[VectorCovariance]) -> VectorCovariance:
    """Parts of a motion, one after another."""
    given, by_shape = ([getattr(x, f.name) for x in parts] for f in fields(VectorCovariance))
    return VectorCovariance(torch.cat(given), torch.cat(by_shape))


def vector_covariance(
    by_frame: Float[Tensor, "T K 3 75"],
    by_shape: Float[Tensor, "T K 3 10"] | None,
    frames: Float[Tensor, "T 75 75"],
    response: Float[Tensor, "T 75 10"],
) -> VectorCovariance:
    """Covariance of vectors from that of a motion's increments.

    Args:
        by_frame, by_shape: derivatives of the vectors; None: the shape does not move them.
        frames: covariance of the increments, the shape known.
        response: with -response, frames follow the shape.
    """
    half = (by_frame.flatten(1, 2) @ frames).unflatten(1, by_frame.shape[1:3])
    follow = -torch.einsum("tkxn,tni->tkxi", by_frame, response)
    return VectorCovariance(half @ by_frame.mT, follow if by_shape is None else by_shape + follow)


def joint_jacobian(
    body: Body, motion: MotionState, frames: slice = slice(None)
) -> tuple[Float[Tensor, "T 24 3 75"], Float[Tensor, "T 24 3 10"]]:
    """Derivatives of joints about the middle of the hips by a motion's increments and its shape, of
    some frames."""
    points = body.derivatives(body.joints, motion, frames)
    assert points.d_pose is not None
    assert points.d_beta is not None
    d_pose, d_beta = points.d_pose[0], points.d_beta[0]
    return _about_hips(of_whole_frame(d_pose)), _about_hips(d_beta)


def of_whole_frame(by_pose: Float[Tensor, "T K 3 72"]) -> Float[Tensor, "T K 3 75"]:
    """Derivatives by a frame's increments of what its place in space does not move."""
    return torch.cat([by_pose, torch.zeros_like(by_pose[..., :3])], -1)


def _about_hips(rows: Tensor) -> Tensor:
    return rows - rows[:, HIPS].mean(1, keepdim=True)
