"""The low-rank targets Z and Y of Eq. 8, carried from the reference's axis to every video."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.consensus import Aligned, Cameras, to_world
from imocap_core.motion.multiview.lowrank import low_rank_paths, low_rank_poses
from imocap_core.motion.multiview.timeline import Timeline, sample, sample_rotations
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import PathCoupling, PoseCoupling, Term


@dataclass(frozen=True)
class Targets:
    """What each video is drawn to, in its own axes and at its own frames.

    Attributes:
        R_local: (B, T, 24, 3, 3); pelvis: (B, T, 3) metres.
        trust: (B, T) confidence of the match, 0 for frames without one.
    """

    R_local: Tensor
    pelvis: Tensor
    trust: Tensor


def low_rank_targets(
    aligned: Aligned, cameras: Cameras, joint_weight: Tensor, rank: int
) -> tuple[Tensor, Tensor]:
    """Z (M, N, 24, 3, 3) and Y (M, N, 3) in the world's axes: the SVD step of Eq. 8."""
    world = to_world(aligned, cameras)
    Z = low_rank_poses(world.R_local, joint_weight, rank)
    Y = low_rank_paths(world.pelvis, world.weight, rank)
    return Z, Y


def to_own_axes(
    Z: Tensor,
    Y: Tensor,
    cameras: Cameras,
    timeline: Timeline,
    confidences: list[np.ndarray],
    state: MotionState,
) -> Targets:
    """World targets (M, N, ...) at each video's own frames and in its own camera's axes."""
    R_local, path = state.R_local.clone(), state.trans.clone()
    trust = state.trans.new_zeros(state.valid.shape)
    for v, at in enumerate(timeline.to_reference):
        known = np.isfinite(at)
        filled = (
            np.interp(np.arange(len(at)), np.nonzero(known)[0], at[known]) if known.any() else at
        )
        length = len(at)
        R = sample_rotations(Z[v], filled)
        R[:, 0] = cameras.R[v] @ R[:, 0]
        R_local[v, :length] = R
        path[v, :length] = sample(Y[v], filled) @ cameras.R[v].T + cameras.t[v]
        trust[v, :length] = torch.as_tensor(np.where(known, confidences[v], 0.0)).to(trust)
    return Targets(R_local, path, trust)


def coupling_terms(
    body: Body,
    targets: Targets,
    state: MotionState,
    joint_weight: Tensor,
    path_weight: Tensor,
) -> list[Term]:
    """Eq. 8's two coupling terms.

    Args:
        joint_weight: broadcastable to (B, T, 24), 1/rad^2; path_weight: to (B, T), 1/m^2.
    """
    rest = body.model.shape(state.betas).joints_rest[:, 0]
    pose = (targets.trust[..., None] * joint_weight).expand(*targets.trust.shape, 24)
    return [
        PoseCoupling(targets.R_local, pose),
        PathCoupling(targets.pelvis - rest[:, None], targets.trust * path_weight),
    ]


def to_own_time(on_axis: Tensor, timeline: Timeline, state: MotionState) -> Tensor:
    """(M, N, J) on the reference's axis to (M, T, J) at each video's frames (nearest)."""
    out = on_axis.new_zeros(*state.valid.shape, on_axis.shape[-1])
    for v, at in enumerate(timeline.to_reference):
        known = np.isfinite(at)
        nearest = np.clip(np.nan_to_num(at).round().astype(int), 0, on_axis.shape[1] - 1)
        index = torch.as_tensor(nearest, device=on_axis.device)
        out[v, : len(at)] = on_axis[v, index] * torch.as_tensor(known).to(on_axis)[:, None]
    return out
