"""Agreement between videos, joint by joint, and their mean motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.multiview.aligned import AlignedMotions, align
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.state import MotionState
from imocap_core.motion.window import running_mean
from imocap_core.robust import geman_mcclure_weight
from imocap_core.rotations import geodesic_angle, project
from imocap_core.rotations import mean as chordal_mean

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
