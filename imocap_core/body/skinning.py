"""Linear blend skinning of the whole surface (SMPL, Eq. 6 of Loper et al. 2015).

Bone k moves a rest vertex x to ``R_k (x - rest_k) + joint_k``; a skinned vertex is the weighted
mean over its bones.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.body.points import pose_features, rows_of, turn
from imocap_core.body.protocols import PosedArrays, ShapedArrays

_BODIES_AT_ONCE = 4  # keeps a chunk's 12 numbers a vertex within the processor's cache


def skin(posed: PosedArrays) -> Float[Tensor, "... V 3"]:
    """Posed vertices, metres."""
    rest = posed.shaped.joints_rest
    shared = rest.ndim == 2 or (rest.shape[-3] == 1 and posed.R_world.ndim > 3)
    if posed.shaped.model.posedirs is None and shared:
        return _skin_shared(posed)
    return _skin_each(posed)


def _skin_shared(posed: PosedArrays) -> Float[Tensor, "... V 3"]:
    """Many poses of one rest surface: one matrix product of all bones and weighted vertices."""
    rows = torch.cat((rows_of(posed.R_world), posed.joints.transpose(-1, -2)), dim=-1)
    return turn(rows, posed.shaped.weighted_rest).transpose(-1, -2)


def weighted_rest(shaped: ShapedArrays) -> Float[Tensor, "... P V"]:
    """Rest vertices from each joint by their skinning weights, and the weights, P = 4 J.

    The same for all poses of a shape, and half of the work of skinning 32 of them.
    """
    weights = shaped.model.weights
    local = shaped.vertices_rest[..., None, :] - shaped.joints_rest[..., None, :, :]
    weighted = (weights[..., None] * local).flatten(-2).transpose(-1, -2)  # (..., 3 J, V)
    offsets = weights.T.expand(*weighted.shape[:-2], -1, -1)
    return torch.cat((weighted, offsets), dim=-2)


def _skin_each(posed: PosedArrays) -> Float[Tensor, "... V 3"]:
    """Bodies of different shapes, or with pose blend shapes: a few at a time."""
    shaped, model = posed.shaped, posed.shaped.model
    batch = posed.joints.shape[:-2]
    moved_rest = (posed.R_world @ shaped.joints_rest[..., None])[..., 0]
    bones = torch.cat((posed.R_world, (posed.joints - moved_rest)[..., None]), dim=-1)
    bones = bones.expand(*batch, -1, 3, 4).reshape(-1, len(model.parents), 3, 4)
    bones = bones.movedim(1, -1)  # (N, 3, 4, J)
    vertices = shaped.vertices_rest.transpose(-1, -2)
    vertices = vertices.expand(*batch, *vertices.shape[-2:]).reshape(-1, *vertices.shape[-2:])
    features = pose_features(posed.R_local)
    features = features.expand(*batch, -1).reshape(-1, features.shape[-1])
    done = []
    for first in range(0, len(bones), _BODIES_AT_ONCE):
        part = slice(first, first + _BODIES_AT_ONCE)
        rest = vertices[part]
        if model.posedirs is not None:
            bend = features[part] @ model.posedirs.flatten(0, 1).T
            rest = rest + bend.unflatten(-1, (-1, 3)).transpose(-1, -2)
        blended = bones[part] @ model.weights.T  # (n, 3, 4, V)
        done.append((blended[:, :, :3] * rest[:, None]).sum(2) + blended[:, :, 3])
    return torch.cat(done).transpose(-1, -2).unflatten(0, batch) if batch else done[0][0].T
