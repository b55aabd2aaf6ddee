"""Between the ways in which the field writes down a body's pose (docs/conventions.md)."""

from __future__ import annotations

import torch
from torch import Tensor

from imocap_core import rotations as so3
from imocap_core.body.model import Model
from imocap_core.conventions import SMPLH_JOINTS

# The joints of one hand in SMPL+H's order: index, middle, pinky, ring (three each), thumb.
_KNUCKLES = {side: [SMPLH_JOINTS.index(f"{side}_{finger}1") for finger in
             ("index", "middle", "pinky", "ring")] for side in ("left", "right")}  # fmt: skip


def rotations_from_pose(theta: Tensor) -> Tensor:
    """Axis-angle poses (..., 3 J), radians, to local rotations (..., J, 3, 3)."""
    if theta.shape[-1] % 3:
        raise ValueError(f"theta: expected (..., 3 J) axis-angle, got {tuple(theta.shape)}")
    return so3.exp(theta.unflatten(-1, (-1, 3)))


def pose_from_rotations(R_local: Tensor, reference: Tensor | None = None) -> Tensor:
    """Local rotations (..., J, 3, 3) to axis-angle poses (..., 3 J), radians.

    Angles are at most pi, unless a `reference` pose (..., 3 J) says which branch to take.
    """
    vectors = so3.log(R_local)
    if reference is not None:
        vectors = so3.nearest_branch(vectors, reference.unflatten(-1, (-1, 3)))
    return vectors.flatten(-2)


def transl_from_Th(R_global: Tensor, Th: Tensor, pelvis_rest: Tensor) -> Tensor:
    """EasyMocap's Th to SMPL's transl: ``transl = Th + R pelvis - pelvis``.

    Rh / Th turn the body about the origin, ``R x + Th``; SMPL turns it about its pelvis,
    ``R (x - pelvis) + pelvis + transl``. The rotation is the same: global_orient = Rh.

    R_global (..., 3, 3), Th and pelvis_rest (..., 3) metres; pelvis_rest is
    ``shaped.joints_rest[..., 0, :]`` of the body that the file belongs to.
    """
    return Th + (R_global @ pelvis_rest[..., None])[..., 0] - pelvis_rest


def Th_from_transl(R_global: Tensor, transl: Tensor, pelvis_rest: Tensor) -> Tensor:
    """SMPL's transl to EasyMocap's Th: the inverse of `transl_from_Th`."""
    return transl - (R_global @ pelvis_rest[..., None])[..., 0] + pelvis_rest


def smplh_from_smpl(R_local: Tensor, hands: Tensor | None = None) -> Tensor:
    """SMPL poses (..., 24, 3, 3) to SMPL+H poses (..., 52, 3, 3).

    hands (..., 30, 3, 3): finger rotations, left then right. Without them the four fingers of a
    hand turn at their roots as SMPL's hand joint does, and the thumb rests.
    """
    body, (left, right) = R_local[..., :22, :, :], R_local[..., 22:, :, :].unbind(-3)
    if hands is None:
        identity = torch.eye(3, dtype=R_local.dtype, device=R_local.device).expand_as(left)
        rows = [left if j in _KNUCKLES["left"] else identity for j in range(22, 37)]
        rows += [right if j in _KNUCKLES["right"] else identity for j in range(37, 52)]
        hands = torch.stack(rows, dim=-3)
    return torch.cat((body, hands), dim=-3)


def smpl_from_smplh(R_local: Tensor) -> Tensor:
    """SMPL+H poses (..., 52, 3, 3) to SMPL poses (..., 24, 3, 3).

    SMPL has one joint for all fingers: it takes the mean of their four roots.
    """
    hands = [so3.mean(R_local[..., _KNUCKLES[side], :, :], dim=-1) for side in ("left", "right")]
    return torch.cat((R_local[..., :22, :, :], torch.stack(hands, dim=-3)), dim=-3)


def smplx_from_smplh(R_local: Tensor) -> Tensor:
    """SMPL+H poses (..., 52, 3, 3) to SMPL-X poses (..., 55, 3, 3), jaw and eyes at rest."""
    identity = torch.eye(3, dtype=R_local.dtype, device=R_local.device)
    rest = identity.expand(*R_local.shape[:-3], 3, 3, 3)
    return torch.cat((R_local[..., :22, :, :], rest, R_local[..., 22:, :, :]), dim=-3)


def smplh_from_smplx(R_local: Tensor) -> Tensor:
    """SMPL-X poses (..., 55, 3, 3) to SMPL+H poses (..., 52, 3, 3): jaw and eyes are dropped."""
    return torch.cat((R_local[..., :22, :, :], R_local[..., 25:, :, :]), dim=-3)


def hand_pose_from_pca(model: Model, side: str, coefficients: Tensor) -> Tensor:
    """Axis-angle hand pose (..., 45), radians, of coefficients (..., n) in a model's hand space.

    The mean hand is added, as official SMPL+H and SMPL-X do unless `flat_hand_mean` is set.
    """
    if side not in model.hand_pca:
        raise ValueError(f"body model {model.name} has no hand space for side {side!r}")
    mean, components = model.hand_pca[side]
    return mean + coefficients @ components[: coefficients.shape[-1]]
