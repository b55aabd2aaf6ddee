"""One alternation of Eq. 8: Z and Y by SVD, poses by the solver, cameras by PnP."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from imocap_core.camera.pnp import pnp_over_frames
from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.aligned import align
from imocap_core.motion.multiview.cameras import Cameras, cameras_from_motion
from imocap_core.motion.multiview.common_keypoints import CommonKeypoints, common_keypoints
from imocap_core.motion.multiview.consensus import (
    SMOOTH_FRAMES,
    agreement,
    consensus_motion,
    to_world,
)
from imocap_core.motion.multiview.coupling import (
    coupling_terms,
    low_rank_targets,
    to_video_axes,
    to_video_frames,
)
from imocap_core.motion.multiview.scene import Scene, per_video_terms, solve
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams


def low_rank_round(
    scene: Scene, state: MotionState, cameras: Cameras, options: MotionParams, *, pnp: bool
) -> tuple[MotionState, Cameras, float]:
    """Couple every motion to its low-rank approximation; returns motions, cameras and objective.

    Joints that do not follow the other videos are released (leave-one-out, Geman-McClure), so that
    a different performance keeps its own pose.

    Args:
        pnp: refine the cameras by PnP over all frames (section 3.2, "Optimization").
    """
    aligned = align(scene.body, state, scene.timeline)
    world = to_world(aligned, cameras)
    follows = agreement(
        world.R_local, world.weight, scale_rad=options.agreement_rad, smooth_frames=SMOOTH_FRAMES
    )
    Z, Y = low_rank_targets(aligned, cameras, follows * world.weight[..., None], options.rank)
    targets = to_video_axes(Z, Y, cameras, scene.timeline, scene.confidences, state)
    joint_weight = to_video_frames(follows, scene.timeline, state) / options.coupling_rad**2
    path_weight = torch.full_like(targets.trust, options.coupling_path_m**-2)
    terms = per_video_terms(scene, state.trans)
    terms += coupling_terms(scene.body, targets, state, joint_weight, path_weight)
    solution = solve(terms, state, options.max_steps, performers=scene.performers)
    state = solution.state
    cameras = cameras_from_motion(
        align(scene.body, state, scene.timeline), cameras.K, scene.reference
    )
    if pnp:
        keypoints = common_keypoints(scene.observations, scene.timeline)
        common = consensus_motion(scene, state, cameras, options.agreement_rad)
        cameras = refine_by_pnp(
            scene.body, common, keypoints, cameras, scene.reference,
            robust_scale=scene.fit.robust_scale_sigma,
        )  # fmt: skip
    return state, cameras, solution.costs[-1]


def refine_by_pnp(
    body: Body,
    motion: MotionState,
    keypoints: CommonKeypoints,
    cameras: Cameras,
    reference: int,
    *,
    robust_scale: float,
) -> Cameras:
    """Each camera from the common motion's 3D keypoints over all frames (PnP, "Optimization").

    A camera whose PnP fails keeps its place, and so does one that moves.
    """
    xyz = body.positions(body.keypoints, motion).xyz[0].cpu().numpy()
    R, t = cameras.R.clone(), cameras.t.clone()
    for v in range(len(R)):
        if v == reference or not (keypoints.weight[v] > 0).any() or keypoints.moves(v):
            continue
        sigma = float(np.median(keypoints.sigma_px[v]))
        pose = pnp_over_frames(
            xyz,
            keypoints.xy_px[v],
            keypoints.weight[v] * sigma**2,
            cameras.K[v].cpu().numpy(),
            R[v].cpu().numpy(),
            scale_px=robust_scale * sigma,
        )
        if pose.ok:
            R[v], t[v] = torch.as_tensor(pose.R).to(R), torch.as_tensor(pose.t).to(t)
    return replace(cameras, R=R, t=t)
