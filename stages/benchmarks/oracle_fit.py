"""SMPL-BA's shared motion and own deviations with cameras that are known.

Performances that differ share poses, not paths: each video keeps a path of its own (`apart`), as
its camera would otherwise have to take up what it may not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from imocap_core.motion.consensus import Cameras, align, pelvis
from imocap_core.motion.coupled import consensus_motion
from imocap_core.motion.coupling import coupling_terms, to_own_axes, to_own_time
from imocap_core.motion.deviation import joint_spread_rad, keypoint_spread_m
from imocap_core.motion.joint import misfit, one_body
from imocap_core.motion.monocular import regularisers
from imocap_core.motion.own import single_motion
from imocap_core.motion.scene import JointMotion, JointOptions, Scene, own_terms, solve
from imocap_core.motion.shared import Evidence, depths_m, gather, views_of
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Reprojection
from stages.benchmarks.apart import as_if_together, common_and_own, pixels_of

STAGES = (3.0, 1.0, 1.0, 1.0)  # robust scales of the shared fit, relative to the final one


def fit_with_cameras(
    scene: Scene, start: MotionState, cameras: Cameras, options: JointOptions
) -> JointMotion:
    """SMPL-BA's shared motion and own deviations while the cameras stay as they are; every video's
    path may depart from the common one (`apart`).

    One video has nobody to share with: its monocular motion stands, as in `recover_motion`.
    """
    if len(scene.observations) == 1:
        return JointMotion(start, cameras, start, [], "one video: the monocular motion stands", 0.0)
    weights = scene.weights
    state = one_body(start)
    shared = consensus_motion(scene, state, cameras, options)
    evidence = gather(scene.observations, scene.timeline, noise_share=weights.noise_share)
    shift_m = _first_shifts(scene, state, shared, cameras)
    spread_m = np.zeros(evidence.weight.shape)
    costs = []
    for stage in STAGES:
        scale = weights.robust_scale * stage
        shared, shift_m = _on_own_paths(scene, shared, cameras, evidence, shift_m, scale)
        near = _as_if_together(scene, shared, cameras, evidence, shift_m)
        depth = depths_m(scene.body, shared, cameras)
        focal = evidence.K[:, 0, 0, None]
        spread_px = spread_m * (focal / depth)[..., None]
        sigma2 = evidence.sigma_px[..., None] ** 2
        seen = replace(near, weight=near.weight * sigma2 / (sigma2 + spread_px**2))
        views = views_of(seen, cameras, shared.trans, free=())
        terms = [
            Reprojection(scene.body, views, scale),
            *regularisers(scene.prior, weights, scene.fps),
        ]
        solution = solve(terms, shared, options, one_body=False)
        shared = solution.state
        costs.append(solution.costs[-1])
        near = _as_if_together(scene, shared, cameras, evidence, shift_m)
        spread_m = keypoint_spread_m(
            _errors_px(scene, shared, cameras, near),
            evidence.sigma_px,
            depths_m(scene.body, shared, cameras),
            evidence.K[:, 0, 0],
            window=round(scene.fps / 2),
        )
    shared, shift_m = _on_own_paths(scene, shared, cameras, evidence, shift_m, weights.robust_scale)
    state, cost = _own(scene, state, shared, cameras, spread_m, shift_m, options)
    fit = misfit(scene, shared, cameras)
    return JointMotion(state, cameras, shared, [*costs, cost], "true cameras and frames", fit)


def _own(
    scene: Scene,
    state: MotionState,
    shared: MotionState,
    cameras: Cameras,
    spread_m: np.ndarray,
    shift_m: np.ndarray,
    options: JointOptions,
) -> tuple[MotionState, float]:
    """Each video from its own image, drawn to the common motion on its own path."""
    start = single_motion(scene, state, shared, cameras)
    videos = len(scene.observations)
    joints = joint_spread_rad(scene.body, shared, spread_m)
    once = max(1.0, options.correlation_s * scene.fps)
    on_axis = torch.as_tensor(1 / (joints**2 * once)).to(state.trans)
    own_shift = to_own_time(torch.as_tensor(shift_m).to(state.trans), scene.timeline, state)
    start = replace(start, trans=start.trans + own_shift)
    targets = to_own_axes(
        shared.R_local.expand(videos, -1, -1, -1, -1),
        pelvis(scene.body, shared).expand(videos, -1, -1),
        cameras,
        scene.timeline,
        scene.confidences,
        start,
    )
    targets = replace(targets, pelvis=targets.pelvis + own_shift)
    path_weight = torch.full_like(targets.trust, options.coupling_path_m**-2 / once)
    terms = own_terms(scene, start.trans)
    joint_weight = to_own_time(on_axis, scene.timeline, state)
    terms += coupling_terms(scene.body, targets, start, joint_weight, path_weight)
    solution = solve(terms, start, options, one_body=True)
    return solution.state, solution.costs[-1]


def _first_shifts(
    scene: Scene, state: MotionState, shared: MotionState, cameras: Cameras
) -> np.ndarray:
    """(M, N, 3) where each monocular path lies off the common one, in its camera's axes."""
    own = align(scene.body, state, scene.timeline).pelvis
    common = pelvis(scene.body, shared)[0]
    there = torch.einsum("mij,nj->mni", cameras.R, common) + cameras.t[:, None]
    return np.asarray((own - there).cpu().numpy())


def _points_m(scene: Scene, shared: MotionState, cameras: Cameras) -> np.ndarray:
    """(M, N, K, 3) the common motion's keypoints in every camera's axes."""
    xyz = scene.body.positions(scene.body.keypoints, shared).xyz[0]
    seen = torch.einsum("mij,nkj->mnki", cameras.R, xyz) + cameras.t[:, None, None]
    return np.asarray(seen.cpu().numpy())


def _on_own_paths(
    scene: Scene,
    shared: MotionState,
    cameras: Cameras,
    evidence: Evidence,
    start_m: np.ndarray,
    scale: float,
) -> tuple[MotionState, np.ndarray]:
    """The common motion on the path that all videos see, and each one's shifts from it."""
    moved, shift_m = common_and_own(
        _points_m(scene, shared, cameras),
        cameras.R.cpu().numpy(),
        evidence.xy_px,
        evidence.weight,
        evidence.K,
        start_m,
        scale,
    )
    return replace(shared, trans=shared.trans + torch.as_tensor(moved).to(shared.trans)), shift_m


def _as_if_together(
    scene: Scene, shared: MotionState, cameras: Cameras, evidence: Evidence, shift_m: np.ndarray
) -> Evidence:
    points = _points_m(scene, shared, cameras)
    each = zip(points, evidence.xy_px, evidence.K, shift_m, strict=True)
    return replace(evidence, xy_px=np.stack([as_if_together(*given) for given in each]))


def _errors_px(
    scene: Scene, shared: MotionState, cameras: Cameras, evidence: Evidence
) -> np.ndarray:
    """(M, N, K, 2) signed error of the common motion, NaN where nothing was seen."""
    points = _points_m(scene, shared, cameras)
    each = zip(points, evidence.K, evidence.xy_px, strict=True)
    errors = np.stack([pixels_of(p, K) - xy for p, K, xy in each])
    return np.where(evidence.weight[..., None] > 0, errors, np.nan)
