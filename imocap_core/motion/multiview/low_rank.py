"""The low-rank model of motions across videos: Z and Y of Eq. 4, 5, 8, and their mean motion.

The low-rank model of motions across videos, Eq. 4, 5 and the Z, Y updates of Eq. 8.

Coupling targets (Z and Y of Eq. 8), carried from the reference's frames to every video.

Agreement between videos, joint by joint, and their mean motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.multiview.scene import AlignedMotions, Cameras, Scene, align
from imocap_core.motion.multiview.timeline import Timeline, sample, sample_rotations
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import JointEvidence, PathCoupling, PoseCoupling, Term
from imocap_core.motion.terms.base import running_mean
from imocap_core.robust import geman_mcclure_weight
from imocap_core.rotations import exp, geodesic_angle, log, project
from imocap_core.rotations import mean as chordal_mean
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


# The keypoints whose positions are coupled; every layout of a body has them.
COUPLED = frozenset(
    f"{side}_{joint}"
    for side in ("left", "right")
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
) | {"nose"}
UNBOUNDED = 1e3  # Geman-McClure scale: no deviation is an outlier


@dataclass(frozen=True)
class CouplingTargets:
    """What each video is coupled to, in its own camera's axes and at its own frames.

    Attributes:
        R_local: (B, T, 24, 3, 3); root: (B, T, 3) metres, the root joint.
        trust: (B, T) confidence of the match, 0 for frames without one.
    """

    R_local: Float[Tensor, "B T 24 3 3"]
    root: Float[Tensor, "B T 3"]
    trust: Float[Tensor, "B T"]


def low_rank_targets(
    aligned: AlignedMotions, cameras: Cameras, joint_weight: Float[Tensor, "M N 24"], rank: int
) -> tuple[Float[Tensor, "M N 24 3 3"], Float[Tensor, "M N 3"]]:
    """Z and Y in the world's axes: the SVD step of Eq. 8."""
    world = to_world(aligned, cameras)
    Z = low_rank_poses(world.R_local, joint_weight, rank)
    Y = low_rank_paths(world.root, world.weight, rank)
    return Z, Y


def to_video_axes(
    Z: Float[Tensor, "M N 24 3 3"],
    Y: Float[Tensor, "M N 3"],
    cameras: Cameras,
    timeline: Timeline,
    confidences: Sequence[Float[np.ndarray, " _"]],
    state: MotionState,
) -> CouplingTargets:
    """World targets at each video's own frames and in its own camera's axes.

    Args:
        state: stands in for the targets of padded frames.
    """
    R_local, path = state.R_local.clone(), state.trans.clone()
    trust = state.trans.new_zeros(state.valid.shape)
    for v, position in enumerate(timeline.to_reference):
        matched, length = np.isfinite(position), len(position)
        filled = position
        if matched.any():
            filled = np.interp(np.arange(length), np.nonzero(matched)[0], position[matched])
        R = sample_rotations(Z[v], filled)
        R[:, 0] = cameras.R[v] @ R[:, 0]
        R_local[v, :length] = R
        path[v, :length] = sample(Y[v], filled) @ cameras.R[v].T + cameras.t[v]
        trust[v, :length] = torch.as_tensor(np.where(matched, confidences[v], 0.0)).to(trust)
    return CouplingTargets(R_local, path, trust)


def coupling_terms(
    body: Body,
    targets: CouplingTargets,
    state: MotionState,
    joint_weight: Float[Tensor, "#B #T #24"],
    path_weight: Float[Tensor, "#B #T"],
) -> list[Term]:
    """Eq. 8's two coupling terms.

    Args:
        joint_weight: 1/rad^2; path_weight: 1/m^2; both broadcast.
    """
    rest = body.model.shape(state.betas).joints_rest[:, 0]
    pose = (targets.trust[..., None] * joint_weight).expand(*targets.trust.shape, 24)
    return [
        PoseCoupling(targets.R_local, pose),
        PathCoupling(targets.root - rest[:, None], targets.trust * path_weight),
    ]


def position_coupling(
    body: Body,
    targets: CouplingTargets,
    state: MotionState,
    weight: Float[Tensor, "B T K"],
) -> JointEvidence:
    """Positions of the limbs' keypoints and the nose, coupled to the target's after the best
    rotation and shift of each frame.

    With rotations coupled one by one, the deviations of all joints above a hand add up. This
    correlates them: what they come to together is bounded (docs/decisions.md).

    Args:
        state: its shapes are the targets'; weight: of the layout's keypoints, 1/m^2.
    """
    names = body.keypoints.names  # of several layouts, where videos differ in them
    share = weight.new_tensor([(name in COUPLED) / names.count(name) for name in names])
    posed = replace(state, R_local=targets.R_local)
    xyz = body.positions(body.keypoints, posed).xyz.detach()
    return JointEvidence(
        body, xyz, targets.trust[..., None] * weight * share, UNBOUNDED, of_keypoints=True
    )


def to_video_frames(
    at_reference: Float[Tensor, "M N J"], timeline: Timeline, state: MotionState
) -> Float[Tensor, "M T J"]:
    """Values at the reference's frames, at each video's own frames (nearest; 0 if unmatched)."""
    out = at_reference.new_zeros(*state.valid.shape, at_reference.shape[-1])
    for v, position in enumerate(timeline.to_reference):
        matched = np.isfinite(position)
        last = at_reference.shape[1] - 1
        nearest = np.clip(np.nan_to_num(position).round().astype(int), 0, last)
        index = torch.as_tensor(nearest, device=at_reference.device)
        values = at_reference[v, index] * torch.as_tensor(matched).to(at_reference)[:, None]
        out[v, : len(position)] = values
    return out


SMOOTH_FRAMES = 7  # over which agreement between videos is averaged


def to_world(aligned: AlignedMotions, cameras: Cameras) -> AlignedMotions:
    """The same motions, from their own cameras' axes into the world's."""
    R_world_from_cam = cameras.R.transpose(-1, -2)
    R_local = aligned.R_local.clone()
    R_local[:, :, 0] = R_world_from_cam[:, None] @ R_local[:, :, 0]
    centred = aligned.root - cameras.t[:, None]
    return replace(
        aligned,
        R_local=R_local,
        root=torch.einsum("mij,mnj->mni", R_world_from_cam, centred),
    )


def agreement(
    R: Float[Tensor, "M N J 3 3"],
    weight: Float[Tensor, "M N"],
    *,
    scale_rad: float,
    smooth_frames: int,
) -> Float[Tensor, "M N J"]:
    """Geman-McClure weight of each joint's angle to the mean of the OTHER videos.

    Leaving the video itself out matters with few videos: it would otherwise vote for itself.

    Args:
        R: local rotations in common axes; weight: trust in each match.
        scale_rad: angle at which the weight has fallen to a quarter.
        smooth_frames: angles are averaged over this many frames, so that monocular noise in single
            frames changes little.

    Returns:
        Weights in [0, 1], 0 for unmatched frames.
    """
    weighted = weight[..., None, None, None] * R
    others = weighted.sum(0, keepdim=True) - weighted
    any_other = (weight.sum(0, keepdim=True) - weight) > 1e-6
    eye = torch.eye(3).to(R)
    consensus = project(torch.where(any_other[..., None, None, None], others, eye))
    angle = geodesic_angle(R, consensus).movedim(1, 2)  # (M, J, N)
    angle = running_mean(angle, smooth_frames // 2).movedim(2, 1)
    follows = geman_mcclure_weight(angle, scale_rad)
    return torch.where(any_other[..., None], follows, 1.0) * (weight > 0)[..., None]


def consensus_motion(
    scene: Scene, state: MotionState, cameras: Cameras, agreement_rad: float
) -> MotionState:
    """The mean motion of all videos at the reference's frames (batch of 1, world axes).

    Args:
        state: every video's motion in its own camera's axes.
        agreement_rad: a joint that differs by more than this from the others counts little.
    """
    world = to_world(align(scene.body, state, scene.timeline), cameras)
    follows = agreement(
        world.R_local, world.weight, scale_rad=agreement_rad, smooth_frames=SMOOTH_FRAMES
    )
    R = chordal_mean(world.R_local, follows * world.weight[..., None])
    path = world.root[scene.reference]
    shapes = mean_shapes(state, scene.performers)
    rest = scene.body.model.shape(shapes[:1]).joints_rest[:, 0]
    valid = torch.ones(1, len(path), dtype=torch.bool, device=path.device)
    motion = MotionState.of(R[None], (path - rest)[None], shapes[:1], valid)
    return replace(motion, other_betas=shapes[None, 1:])


def mean_shapes(state: MotionState, performers: Sequence[int]) -> Float[Tensor, "P 10"]:
    """Of each performer the mean shape of the videos that show it."""
    rows = torch.tensor(list(performers), device=state.betas.device)
    return torch.stack([state.betas[rows == p].mean(0) for p in range(max(performers) + 1)])
