"""SMPL-BA: the motion of every video and all cameras, jointly (Eq. 8).

Two ways behind one parameter. ``paper`` alternates as the paper does: Z and Y by SVD, poses and
paths by the solver, cameras by PnP. ``shared`` (default) starts from one such round, then fits
ONE motion to all views' 2D at once and gives each video back as much freedom as its own image
evidence asks for. ``single`` stops before that last step: one model for all videos.
"""

from dataclasses import replace

import numpy as np
import torch

from imocap_core.motion.consensus import Cameras, align, cameras_from_motion
from imocap_core.motion.coupled import consensus_motion, coupled_round
from imocap_core.motion.deviation import Spread, keypoint_spread_m
from imocap_core.motion.monocular import Progress, regularisers
from imocap_core.motion.own import own_deviations, single_motion
from imocap_core.motion.robust import geman_mcclure
from imocap_core.motion.scene import JointMotion, JointOptions, Scene
from imocap_core.motion.shared import (
    Evidence,
    depths_m,
    estimates_on_axis,
    fit_shared,
    gather,
    reprojection_errors_px,
)
from imocap_core.motion.state import MotionState
from imocap_core.motion.straying import estimate_strays, first_strays

ROBUST_STAGES = (3.0, 1.0, 1.0)  # of the shared fit, relative to the final scale


def recover_motion(
    scene: Scene, start: MotionState, options: JointOptions, progress: Progress = lambda _: None
) -> JointMotion:
    """SMPL-BA from motions in their own camera axes (batch of M) and correspondences."""
    if len(scene.observations) == 1:
        eye, zero = torch.eye(3).to(start.trans)[None], torch.zeros(1, 3).to(start.trans)
        status = "one video: the monocular motion stands"
        return JointMotion(start, Cameras(eye, zero), start, [], status, 0.0)
    state, costs = one_body(start), []
    cameras = cameras_from_motion(align(scene.body, state, scene.timeline), scene.reference)
    rounds = options.rounds if options.objective == "paper" else 1
    for round_ in range(rounds):
        progress(f"coupled fit {round_ + 1} of {rounds}")
        pnp = options.objective == "paper" and round_ > 0
        state, cameras, cost = coupled_round(scene, state, cameras, options, pnp=pnp)
        costs.append(cost)
    if options.objective == "paper":
        common = consensus_motion(scene, state, cameras, options)
        said = f"{rounds} alternations of Eq. 8"
        return JointMotion(state, cameras, common, costs, said, misfit(scene, common, cameras))
    return _shared_then_own(scene, state, cameras, options, costs, progress)


def one_body(state: MotionState) -> MotionState:
    """All videos show one performer: everybody starts with the mean shape."""
    mean = state.betas.mean(0, keepdim=True)
    return replace(state, betas=mean.expand_as(state.betas).clone())


def misfit(
    scene: Scene, shared: MotionState, cameras: Cameras, stray: np.ndarray | None = None
) -> float:
    """Mean Geman-McClure reprojection cost a keypoint of one motion for all videos."""
    evidence = gather(scene.observations, scene.timeline, noise_share=scene.weights.noise_share)
    evidence = replace(evidence, stray=stray)
    errors = reprojection_errors_px(
        scene.body, shared, evidence, cameras, robust_scale=scene.weights.robust_scale
    )
    squared = evidence.weight * np.nan_to_num(errors**2).sum(-1)
    cost, _ = geman_mcclure(torch.as_tensor(squared), 3 * scene.weights.robust_scale)
    seen = max(int((evidence.weight > 0).sum()), 1)
    return float(cost.sum()) / seen


def _shared_then_own(
    scene: Scene,
    state: MotionState,
    cameras: Cameras,
    options: JointOptions,
    costs: list[float],
    progress: Progress,
) -> JointMotion:
    """One motion for all views, then each video's own deviation from it."""
    weights = scene.weights
    evidence = gather(scene.observations, scene.timeline, noise_share=weights.noise_share)
    if options.objective != "single":
        evidence = replace(evidence, stray=first_strays(len(scene.observations)))
    shared = consensus_motion(scene, state, cameras, options)
    terms = regularisers(scene.prior, weights, scene.fps) + estimates_on_axis(
        scene.body, scene.observations, scene.timeline, shared.trans,
        evidence_mm=weights.evidence_mm * options.once(scene.fps) ** 0.5,
    )  # fmt: skip
    spread_m = np.zeros(evidence.weight.shape)
    status = ""
    for stage in ROBUST_STAGES:
        progress(f"one motion for all views, robust scale {stage:g}x")
        scale = weights.robust_scale * stage
        shared, cameras, solution = fit_shared(
            scene.body, shared, _with_spread(evidence, spread_m, scene, shared, cameras), cameras,
            scene.reference, terms, options, robust_scale=scale,
        )  # fmt: skip
        evidence = estimate_strays(scene.body, shared, evidence, cameras, robust_scale=scale)
        spread_m = _spread_m(evidence, scene, shared, cameras)
        costs.append(solution.costs[-1])
        status = solution.status
    fit = misfit(scene, shared, cameras, evidence.stray)
    if evidence.stray is None:
        own = single_motion(scene, state, shared, cameras)
        return JointMotion(own, cameras, shared, costs, f"one motion for all: {status}", fit)
    progress("each video's own deviation")
    spread = Spread(spread_m, evidence.stray)
    state, cost = own_deviations(scene, state, shared, cameras, spread, options)
    return JointMotion(state, cameras, shared, [*costs, cost], f"shared motion {status}", fit)


def _spread_m(
    evidence: Evidence, scene: Scene, shared: MotionState, cameras: Cameras
) -> np.ndarray:
    errors = reprojection_errors_px(
        scene.body, shared, evidence, cameras, robust_scale=scene.weights.robust_scale
    )
    depth = depths_m(scene.body, shared, cameras)
    return keypoint_spread_m(
        errors, evidence.sigma_px, depth, evidence.K[:, 0, 0], window=round(scene.fps / 2)
    )


def _with_spread(
    evidence: Evidence, spread_m: np.ndarray, scene: Scene, shared: MotionState, cameras: Cameras
) -> Evidence:
    """Evidence whose noise holds how far a performance strays from the common one."""
    depth = depths_m(scene.body, shared, cameras)
    spread_px = spread_m * (evidence.K[:, 0, 0, None] / depth)[..., None]
    sigma2 = evidence.sigma_px[..., None] ** 2
    return replace(evidence, weight=evidence.weight * sigma2 / (sigma2 + spread_px**2))
