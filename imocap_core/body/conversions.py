"""Conversions between the pose parameters of SMPL-family models (docs/conventions.md)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core import rotations as so3
from imocap_core.body.model import Model
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
    R_local: Float[Tensor, "... J 3 3"], reference: Float[Tensor, "... P"] | None = None
) -> Float[Tensor, "... P"]:
    """Local rotations to axis-angle poses, P = 3 J, radians.

    Angles are at most pi, or on the branch nearest to a `reference` pose.
    """
    vectors = so3.log(R_local)
    if reference is not None:
        vectors = so3.nearest_branch(vectors, reference.unflatten(-1, (-1, 3)))
    return vectors.flatten(-2)


def transl_from_Th(
    R_global: Float[Tensor, "... 3 3"],
    Th: Float[Tensor, "... 3"],
    pelvis_rest: Float[Tensor, "... 3"],
) -> Float[Tensor, "... 3"]:
    """EasyMocap's Th to SMPL's transl, metres: ``transl = Th + R pelvis - pelvis``.

    Rh / Th rotate the body about the origin, ``R x + Th``; SMPL rotates it about its pelvis,
    ``R (x - pelvis) + pelvis + transl``. The rotation is the same: global_orient = Rh.

    pelvis_rest: ``shaped.joints_rest[..., 0, :]`` of the file's body.
    """
    return Th + (R_global @ pelvis_rest[..., None])[..., 0] - pelvis_rest


def Th_from_transl(
    R_global: Float[Tensor, "... 3 3"],
    transl: Float[Tensor, "... 3"],
    pelvis_rest: Float[Tensor, "... 3"],
) -> Float[Tensor, "... 3"]:
    """SMPL's transl to EasyMocap's Th: the inverse of `transl_from_Th`."""
    return transl - (R_global @ pelvis_rest[..., None])[..., 0] + pelvis_rest


def smplh_from_smpl(
    R_local: Float[Tensor, "... 24 3 3"], hands: Float[Tensor, "... 30 3 3"] | None = None
) -> Float[Tensor, "... 52 3 3"]:
    """SMPL poses to SMPL+H poses.

    hands: finger rotations, left then right. Without them the four fingers of a hand rotate at
    their roots like SMPL's hand joint, and the thumb is at rest.
    """
    body, (left, right) = R_local[..., :22, :, :], R_local[..., 22:, :, :].unbind(-3)
    if hands is None:
        identity = torch.eye(3, dtype=R_local.dtype, device=R_local.device).expand_as(left)
        rows = [left if j in _KNUCKLES["left"] else identity for j in range(22, 37)]
        rows += [right if j in _KNUCKLES["right"] else identity for j in range(37, 52)]
        hands = torch.stack(rows, dim=-3)
    return torch.cat((body, hands), dim=-3)


def smpl_from_smplh(R_local: Float[Tensor, "... 52 3 3"]) -> Float[Tensor, "... 24 3 3"]:
    """SMPL+H poses to SMPL poses.

    SMPL's hand joint, the one joint of all fingers, gets the mean rotation of their four roots.
    """
    hands = [so3.mean(R_local[..., _KNUCKLES[side], :, :], dim=-1) for side in ("left", "right")]
    return torch.cat((R_local[..., :22, :, :], torch.stack(hands, dim=-3)), dim=-3)


def smplx_from_smplh(R_local: Float[Tensor, "... 52 3 3"]) -> Float[Tensor, "... 55 3 3"]:
    """SMPL+H poses to SMPL-X poses, jaw and eyes at rest."""
    identity = torch.eye(3, dtype=R_local.dtype, device=R_local.device)
    rest = identity.expand(*R_local.shape[:-3], 3, 3, 3)
    return torch.cat((R_local[..., :22, :, :], rest, R_local[..., 22:, :, :]), dim=-3)


def smplh_from_smplx(R_local: Float[Tensor, "... 55 3 3"]) -> Float[Tensor, "... 52 3 3"]:
    """SMPL-X poses to SMPL+H poses: jaw and eyes are dropped."""
    return torch.cat((R_local[..., :22, :, :], R_local[..., 25:, :, :]), dim=-3)


def hand_pose_from_pca(
    model: Model, side: str, coefficients: Float[Tensor, "... n"]
) -> Float[Tensor, "... 45"]:
    """Axis-angle hand pose, radians, from coefficients in a model's PCA space of hands.

    The mean hand is added, as official SMPL+H and SMPL-X do unless `flat_hand_mean` is set.
    ValueError when the model has no such space.
    """
    if side not in model.hand_pca:
        raise ValueError(f"body model {model.name} has no hand space for side {side!r}")
    mean, components = model.hand_pca[side]
    return mean + coefficients @ components[: coefficients.shape[-1]]
