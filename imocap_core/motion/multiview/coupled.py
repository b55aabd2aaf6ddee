"""One alternation of Eq. 8: Z and Y by SVD, poses by the solver, cameras by PnP."""

import torch

from imocap_core.motion.multiview.consensus import (
    Cameras,
    agreement,
    align,
    cameras_from_motion,
    to_world,
)
from imocap_core.motion.multiview.coupling import (
    coupling_terms,
    low_rank_targets,
    to_own_axes,
    to_own_time,
)
from imocap_core.motion.multiview.scene import Scene, own_terms, solve
from imocap_core.motion.multiview.shared import gather, refine_by_pnp
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams
from imocap_core.rotations import mean as chordal_mean

SMOOTH_FRAMES = 7  # over which agreement between videos is judged


def coupled_round(
    scene: Scene, state: MotionState, cameras: Cameras, options: MotionParams, *, pnp: bool
) -> tuple[MotionState, Cameras, float]:
    """The state drawn to its low-rank neighbours, the cameras that follow, and the objective.

    Joints that do not follow the other videos are released (leave-one-out, Geman-McClure), so a
    different performance keeps its own pose instead of spoiling everybody's.

    Args:
        pnp: refine the cameras by PnP over all frames (section 3.2, "Optimization").
    """
    aligned = align(scene.body, state, scene.timeline)
    world = to_world(aligned, cameras)
    follows = agreement(
        world.R_local, world.weight, scale_rad=options.agreement_rad, smooth_frames=SMOOTH_FRAMES
    )
    Z, Y = low_rank_targets(aligned, cameras, follows * world.weight[..., None], options.rank)
    targets = to_own_axes(Z, Y, cameras, scene.timeline, scene.confidences, state)
    joint_weight = to_own_time(follows, scene.timeline, state) / options.coupling_rad**2
    path_weight = torch.full_like(targets.trust, options.coupling_path_m**-2)
    terms = own_terms(scene, state.trans)
    terms += coupling_terms(scene.body, targets, state, joint_weight, path_weight)
    solution = solve(terms, state, options, one_body=True)
    state = solution.state
    cameras = cameras_from_motion(
        align(scene.body, state, scene.timeline), cameras.K, scene.reference
    )
    if pnp:
        weights = scene.weights
        evidence = gather(scene.observations, scene.timeline)
        common = consensus_motion(scene, state, cameras, options)
        cameras = refine_by_pnp(
            scene.body, common, evidence, cameras, scene.reference,
            robust_scale=weights.robust_scale_sigma,
        )  # fmt: skip
    return state, cameras, solution.costs[-1]


def consensus_motion(
    scene: Scene, state: MotionState, cameras: Cameras, options: MotionParams
) -> MotionState:
    """The mean motion of all videos on the reference's axis (batch of 1, world axes)."""
    world = to_world(align(scene.body, state, scene.timeline), cameras)
    follows = agreement(
        world.R_local, world.weight, scale_rad=options.agreement_rad, smooth_frames=SMOOTH_FRAMES
    )
    R = chordal_mean(world.R_local, follows * world.weight[..., None])
    path = world.pelvis[scene.reference]
    betas = state.betas.mean(0, keepdim=True)
    rest = scene.body.model.shape(betas).joints_rest[:, 0]
    valid = torch.ones(1, len(path), dtype=torch.bool, device=path.device)
    return MotionState.of(R[None], (path - rest)[None], betas, valid)
