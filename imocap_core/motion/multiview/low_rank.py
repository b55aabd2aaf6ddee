"""The low-rank model of motions across videos (Eq. 4, 5) and one round of Eq. 8's alternation.

Z and Y by SVD, poses and paths by the solver, cameras by rigid alignment or PnP: SMPL-BA as in the
paper. Ours is `smpl_ba.recover_motion`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.camera.pnp import pnp_over_frames
from imocap_core.motion.monocular.fit import Progress
from imocap_core.motion.multiview.common_motion import estimate_spread, misfit
from imocap_core.motion.multiview.per_video import (
    coupling_terms,
    per_video_terms,
    to_video_axes,
    to_video_frames,
)
from imocap_core.motion.multiview.scene import (
    Cameras,
    JointMotion,
    Scene,
    cameras_from_motion,
    consensus_motion,
    in_world,
    shared_shapes,
    solve,
)
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams
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
    """
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


def low_rank_round(
    scene: Scene, state: MotionState, cameras: Cameras, options: MotionParams, *, pnp: bool
) -> tuple[MotionState, Cameras, float]:
    """Couple every motion to its low-rank approximation; returns motions, cameras and objective.

    Joints that do not follow the other videos are released (leave-one-out, Geman-McClure), so that
    a different performance keeps its own pose.

    Args:
        pnp: refine the cameras by PnP over all frames (section 3.2, "Optimization").
    """
    world, follows = in_world(scene, state, cameras)
    Z = low_rank_poses(world.R_local, follows * world.weight[..., None], options.rank)
    Y = low_rank_paths(world.root, world.weight, options.rank)
    targets = to_video_axes(Z, Y, cameras, scene.timeline, scene.confidences, state)
    joint_weight = to_video_frames(follows, scene.timeline, state) / options.coupling_rad**2
    path_weight = torch.full_like(targets.trust, options.coupling_path_m**-2)
    terms = per_video_terms(scene, state.trans)
    terms += coupling_terms(scene.body, targets, state, joint_weight, path_weight)
    solution = solve(terms, state, options.max_steps, scene.performers)
    state = solution.state
    cameras = cameras_from_motion(scene, state, cameras.K)
    if pnp:
        common = consensus_motion(scene, state, cameras)
        cameras = refine_by_pnp(scene, common, cameras)
    return state, cameras, solution.costs[-1]


def refine_by_pnp(scene: Scene, motion: MotionState, cameras: Cameras) -> Cameras:
    """Each camera from the common motion's 3D keypoints over all frames (PnP, "Optimization").

    A camera whose PnP fails keeps its place, and so does one that moves.
    """
    body, keypoints = scene.body, scene.keypoints
    xyz = body.positions(body.keypoints, motion)[0].cpu().numpy()
    R, t = cameras.R.clone(), cameras.t.clone()
    for v in range(len(R)):
        if v == scene.reference or not (keypoints.weight[v] > 0).any() or keypoints.moves(v):
            continue
        sigma = float(np.median(keypoints.sigma_px[v]))
        pose = pnp_over_frames(
            xyz,
            keypoints.xy_px[v],
            keypoints.weight[v] * sigma**2,
            cameras.K[v].cpu().numpy(),
            R[v].cpu().numpy(),
            scale_px=scene.fit.robust_scale_sigma * sigma,
        )
        if pose.ok:
            R[v], t[v] = torch.as_tensor(pose.R).to(R), torch.as_tensor(pose.t).to(t)
    return replace(cameras, R=R, t=t)


def alternated(
    scene: Scene, start: MotionState, options: MotionParams, progress: Progress = lambda _: None
) -> JointMotion:
    """Section 3.2, "Optimization": the alternations of Eq. 8, of two videos or more.

    start: motions in their own camera axes (batch of M).
    """
    state, costs = shared_shapes(start, scene.performers), []
    cameras = cameras_from_motion(scene, state, scene.K.to(state.trans))
    for round_ in range(options.rounds):
        progress(f"coupled fit {round_ + 1} of {options.rounds}")
        state, cameras, cost = low_rank_round(scene, state, cameras, options, pnp=round_ > 0)
        costs.append(cost)
    common = consensus_motion(scene, state, cameras)
    spread = estimate_spread(scene, common, cameras)
    status = f"{options.rounds} alternations of Eq. 8"
    fit = misfit(scene, common, cameras)
    return JointMotion(state, cameras, common, spread, costs, status, fit)
