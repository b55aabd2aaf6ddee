"""Linear blend skinning of the whole surface (SMPL, Eq. 6 of Loper et al. 2015)."""

from __future__ import annotations

import torch
from torch import Tensor

from imocap_core.body.model import Posed


def pose_features(R_local: Tensor) -> Tensor:
    """What pose blend shapes multiply: ``R_local[1:] - I`` flattened, (..., 9 (J - 1))."""
    identity = torch.eye(3, dtype=R_local.dtype, device=R_local.device)
    return (R_local[..., 1:, :, :] - identity).flatten(-3)


def skin(posed: Posed) -> Tensor:
    """Posed vertices (..., V, 3), metres."""
    shaped, model = posed.shaped, posed.shaped.model
    vertices = shaped.vertices_rest
    if model.posedirs is not None:
        features = pose_features(posed.R_local)
        offsets = features @ model.posedirs.flatten(0, 1).T
        vertices = vertices + offsets.unflatten(-1, (-1, 3))
    # A bone carries a rest vertex x to R x + (joint - R joint_rest).
    moved_rest = (posed.R_world @ shaped.joints_rest[..., None])[..., 0]
    bones = torch.cat((posed.R_world, (posed.joints - moved_rest)[..., None]), dim=-1)
    blended = (model.weights @ bones.flatten(-2)).unflatten(-1, (3, 4))
    return (blended[..., :3] @ vertices[..., None])[..., 0] + blended[..., 3]
