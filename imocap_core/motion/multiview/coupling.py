"""Coupling targets (Z and Y of Eq. 8), carried from the reference's frames to every video."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.aligned import AlignedMotions
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.consensus import to_world
from imocap_core.motion.multiview.low_rank import low_rank_paths, low_rank_poses
from imocap_core.motion.multiview.timeline import Timeline, sample, sample_rotations
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import JointEvidence, PathCoupling, PoseCoupling, Term

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
