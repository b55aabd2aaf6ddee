"""Where the cameras are and what the videos agree on, from each video's own motion.

With every motion kept in its own camera's axes, a camera touches the objective only through the
coupling: its rotation is a robust average of root orientations, its translation a robust
alignment of root paths (the rigid alignment of section 3.2, "Initialization").
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from imocap_core.camera.averaging import mean_rotation, mean_vector
from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.timeline import Timeline, sample, sample_rotations
from imocap_core.motion.state import MotionState
from imocap_core.robust import geman_mcclure_weight
from imocap_core.rotations import geodesic_angle, project
from imocap_core.rotations import mean as chordal_mean

AGREEING_RAD = 0.35  # angle to the consensus at which a root orientation counts a quarter


@dataclass(frozen=True)
class Cameras:
    """R (M, 3, 3), t (M, 3): camera of each video from the world (the reference's camera axes);
    K (M, 3, 3): its intrinsics."""

    R: Tensor
    t: Tensor
    K: Tensor


@dataclass(frozen=True)
class Aligned:
    """All motions at the reference's frames, still in their own camera axes.

    Attributes:
        R_local: (M, N, 24, 3, 3); pelvis: (M, N, 3) metres; weight: (M, N), 0 where unmatched.
    """

    R_local: Tensor
    pelvis: Tensor
    weight: Tensor


def pelvis(body: Body, state: MotionState) -> Tensor:
    """(B, T, 3) where the root joint is: SMPL's translation plus the resting root."""
    rest: Tensor = body.model.shape(state.betas).joints_rest[:, 0]
    return state.trans + rest[:, None]


def align(body: Body, state: MotionState, timeline: Timeline) -> Aligned:
    """Sample every motion at the reference's frames."""
    root = pelvis(body, state)
    R, p = [], []
    for v, at in enumerate(timeline.from_reference):
        length = int(state.valid[v].sum())
        R.append(sample_rotations(state.R_local[v, :length], at))
        p.append(sample(root[v, :length], at))
    weight = torch.as_tensor(timeline.confidence).to(root)
    return Aligned(torch.stack(R), torch.stack(p), weight)


def cameras_from_motion(aligned: Aligned, K: Tensor, reference: int, *, rounds: int = 4) -> Cameras:
    """Robust averages of root orientations and paths, all videos against their consensus.

    The first consensus is the reference alone; each round the consensus of all videos replaces
    it, so that every pair of videos has its say.
    """
    R_root = aligned.R_local[:, :, 0]
    videos = len(R_root)
    R = torch.eye(3).to(R_root).repeat(videos, 1, 1)
    weight = aligned.weight.clone()
    consensus, trust = R_root[reference], weight[reference]
    for _ in range(rounds):
        for v in range(videos):
            relative = R_root[v] @ consensus.transpose(-1, -2)
            share = weight[v] * trust
            if bool((share > 0).any()):
                found = mean_rotation(relative.cpu().numpy(), share.cpu().numpy())
                R[v] = torch.as_tensor(found.R).to(R)
        R = R @ R[reference].transpose(-1, -2)
        R[reference] = torch.eye(3).to(R)
        in_world = R.transpose(-1, -2)[:, None] @ R_root
        consensus = chordal_mean(in_world, weight)
        angle = geodesic_angle(in_world, consensus[None])
        robust = geman_mcclure_weight(angle, AGREEING_RAD, prior=weight)
        consensus = chordal_mean(in_world, robust)
        trust = weight.amax(0)
    return Cameras(R, _translations(aligned, R, reference), K)


def _translations(aligned: Aligned, R: Tensor, reference: int) -> Tensor:
    """Robust mean over frames of ``pelvis_j - R_j pelvis_reference`` (section 3.2)."""
    path = aligned.pelvis[reference]
    shift = aligned.pelvis - torch.einsum("mij,nj->mni", R, path)
    share = aligned.weight * aligned.weight[reference]
    rows = []
    for v in range(len(R)):
        usable = share[v].cpu().numpy()
        if not (usable > 0).any():
            usable = np.ones_like(usable)
        rows.append(mean_vector(shift[v].cpu().numpy(), usable, scale=0.15).mean)
    t = torch.as_tensor(np.stack(rows)).to(R)
    t[reference] = 0.0
    return t


def to_world(aligned: Aligned, cameras: Cameras) -> Aligned:
    """The same motions in the world's axes."""
    R_world_from_cam = cameras.R.transpose(-1, -2)
    R_local = aligned.R_local.clone()
    R_local[:, :, 0] = R_world_from_cam[:, None] @ R_local[:, :, 0]
    centred = aligned.pelvis - cameras.t[:, None]
    return replace(
        aligned,
        R_local=R_local,
        pelvis=torch.einsum("mij,mnj->mni", R_world_from_cam, centred),
    )


def agreement(R: Tensor, weight: Tensor, *, scale_rad: float, smooth_frames: int) -> Tensor:
    """How far each joint of each video follows the OTHER videos: Geman-McClure weights.

    Leaving the video itself out matters with few videos: it would otherwise vote for itself.

    Args:
        R: (M, N, J, 3, 3) local rotations in common axes; weight: (M, N) trust in each match.
        scale_rad: angle at which the weight has fallen to a quarter.
        smooth_frames: angles are averaged over this many frames, so that single frames of
            monocular noise neither join nor leave.

    Returns:
        (M, N, J) in [0, 1], 0 for unmatched frames.
    """
    weighted = weight[..., None, None, None] * R
    others = weighted.sum(0, keepdim=True) - weighted
    heard = (weight.sum(0, keepdim=True) - weight) > 1e-6
    eye = torch.eye(3).to(R)
    consensus = project(torch.where(heard[..., None, None, None], others, eye))
    angle = geodesic_angle(R, consensus).movedim(1, 2)  # (M, J, N)
    half = smooth_frames // 2
    padded = torch.nn.functional.pad(angle, (half, half), mode="replicate")
    angle = padded.unfold(-1, 2 * half + 1, 1).mean(-1).movedim(2, 1)
    follows = geman_mcclure_weight(angle, scale_rad)
    return torch.where(heard[..., None], follows, 1.0) * (weight > 0)[..., None]
