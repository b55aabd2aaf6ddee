"""The low-rank model of motions across videos, Eq. 4, 5 and the Z, Y updates of Eq. 8."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.rotations import exp, log
from imocap_core.rotations import mean as mean_rotation


def low_rank_rows(
    rows: Float[Tensor, "*batch M D"], weight: Float[Tensor, "*batch M"], rank: int
) -> Float[Tensor, "*batch M D"]:
    """Nearest rows of rank at most ``rank - 1`` about their weighted mean.

    Eq. 4 bounds the rank of raw parameter vectors; nearly equal rows spend their first rank on
    the mean. Taking the mean out first keeps that meaning where the origin of the vectors is
    arbitrary (tangent vectors, root paths): rank 1 is "the same", rank 2 adds one mode, ...

    Args:
        rows: one row a video; weight: 0 leaves a video out of the fit.
        rank: s of Eq. 4, at least 1.

    Returns:
        The projections, also of rows of weight 0.

    Raises:
        ValueError: rank below 1.
    """
    if rank < 1:
        raise ValueError(f"rank: expected at least 1, got {rank}")
    share = weight / weight.sum(-1, keepdim=True).clamp_min(1e-12)
    mean = (share[..., None] * rows).sum(-2, keepdim=True)
    if rank == 1:
        return mean.expand_as(rows)
    centred = rows - mean
    root = weight.sqrt()[..., None]
    _, _, Vh = torch.linalg.svd(root * centred, full_matrices=False)
    modes = Vh[..., : rank - 1, :]
    return mean + (centred @ modes.transpose(-1, -2)) @ modes


def low_rank_poses(
    R: Float[Tensor, "M N J 3 3"], weight: Float[Tensor, "M N J"], rank: int
) -> Float[Tensor, "M N J 3 3"]:
    """Z of Eq. 8 on the rotation manifold.

    The branch problem of axis-angle vectors does not arise: deviations are taken in the tangent
    space of the mean rotation of each joint, where they are small.

    Args:
        R: local rotations of M videos at N common frames.
    """
    mean = mean_rotation(R, weight)
    if rank == 1:
        return mean.expand_as(R)
    deviation = log(mean.transpose(-1, -2) @ R)
    rows = deviation.movedim(0, 1).flatten(2)  # (N, M, 3 J)
    joint_weight = weight.movedim(0, 1)  # (N, M, J)
    scale = joint_weight.repeat_interleave(3, dim=-1).sqrt()
    projected = low_rank_rows(rows * scale, joint_weight.amax(-1).gt(0).to(rows), rank)
    back = torch.where(scale > 0, projected / scale.clamp_min(1e-9), 0.0)
    return mean @ exp(back.unflatten(-1, (-1, 3)).movedim(1, 0))


def low_rank_paths(
    paths: Float[Tensor, "M N 3"], weight: Float[Tensor, "M N"], rank: int
) -> Float[Tensor, "M N 3"]:
    """Y of Eq. 8: root paths, centred, over all frames at once.

    Videos that miss frames are completed with the weighted mean path before the projection.
    """
    share = weight / weight.sum(0, keepdim=True).clamp_min(1e-12)
    mean = (share[..., None] * paths).sum(0, keepdim=True)
    filled = torch.where((weight > 0)[..., None], paths, mean)
    if rank == 1:
        return mean.expand_as(paths)
    offsets = filled - mean
    rows = offsets.flatten(1)
    used = (weight > 0).any(1).to(rows)
    return mean + low_rank_rows(rows, used, rank).reshape(paths.shape)
