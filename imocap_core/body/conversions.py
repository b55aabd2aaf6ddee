"""Conversions between the pose parameters of SMPL-family models (docs/conventions.md)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core import rotations as so3
from imocap_core.conventions import SMPLH_JOINTS

# The joints of one hand in SMPL+H's order: index, middle, pinky, ring (three each), thumb.
_KNUCKLES = {side: [SMPLH_JOINTS.index(f"{side}_{finger}1") for finger in
             ("index", "middle", "pinky", "ring")] for side in ("left", "right")}  # fmt: skip


def rotations_from_pose(theta: Float[Tensor, "... P"]) -> Float[Tensor, "... J 3 3"]:
    """Axis-angle poses, P = 3 J, radians, to local rotations.

    ValueError when P is not a multiple of 3.
    """
    if theta.shape[-1] % 3:
        raise ValueError(f"theta: expected (..., 3 J) axis-angle, got {tuple(theta.shape)}")
    return so3.exp(theta.unflatten(-1, (-1, 3)))


def pose_from_rotations(
    R_local: Float[Tensor, "... J 3 3"],
) -> Float[Tensor, "... P"]:
    """Local rotations to axis-angle poses, P = 3 J, radians; angles are at most pi."""
    return so3.log(R_local).flatten(-2)


def smplh_from_smpl(R_local: Float[Tensor, "... 24 3 3"]) -> Float[Tensor, "... 52 3 3"]:
    """SMPL poses to SMPL+H poses.

    The four fingers of a hand rotate at their roots like SMPL's hand joint; the thumb is at rest.
    """
    body, (left, right) = R_local[..., :22, :, :], R_local[..., 22:, :, :].unbind(-3)
    identity = torch.eye(3, dtype=R_local.dtype, device=R_local.device).expand_as(left)
    rows = [left if j in _KNUCKLES["left"] else identity for j in range(22, 37)]
    rows += [right if j in _KNUCKLES["right"] else identity for j in range(37, 52)]
    return torch.cat((body, torch.stack(rows, dim=-3)), dim=-3)
