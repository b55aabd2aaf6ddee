"""The common motion of all videos, then each video's own deviation from it."""

from dataclasses import replace

import numpy as np
import torch

from imocap_core.motion.monocular.fit import Progress, regularisers
from imocap_core.motion.multiview.consensus import Cameras
from imocap_core.motion.multiview.coupled import consensus_motion
from imocap_core.motion.multiview.deviation import Spread, keypoint_spread_m
from imocap_core.motion.multiview.focal_lengths import NO_LENSES, lenses_of
from imocap_core.motion.multiview.per_video import own_deviations, single_motion
from imocap_core.motion.multiview.rigid_offsets import estimate_strays, first_strays
from imocap_core.motion.multiview.scene import JointMotion, Scene, correlation_frames
from imocap_core.motion.multiview.shared import (
    Evidence,
    depths_m,
    estimates_on_axis,
    fit_shared,
    gather,
    reprojection_errors_px,
)
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams
from imocap_core.robust import geman_mcclure

ROBUST_STAGES = (3.0, 1.0, 1.0)  # of the common fit, relative to the final scale


def misfit(
    scene: Scene, shared: MotionState, cameras: Cameras, stray: np.ndarray | None = None
) -> float:
    """Mean Geman-McClure reprojection cost a keypoint of one motion for all videos."""
    evidence = gather(scene.observations, scene.timeline)
    evidence = replace(evidence, stray=stray)
    errors = reprojection_errors_px(
        scene.body, shared, evidence, cameras, robust_scale=scene.weights.robust_scale_sigma
    )
    squared = evidence.weight * np.nan_to_num(errors**2).sum(-1)
    cost, _ = geman_mcclure(torch.as_tensor(squared), 3 * scene.weights.robust_scale_sigma)
    seen = max(int((evidence.weight > 0).sum()), 1)
    return float(cost.sum()) / seen


def common_then_own(
    scene: Scene,
    state: MotionState,
    cameras: Cameras,
    options: MotionParams,
    progress: Progress = lambda _: None,
    *,
    cameras_known: bool = False,
    warm: bool = False,
) -> JointMotion:
    """One motion for all views, then each video's own deviation from it.

    Args:
        state: every video's motion in its own camera's axes, one body; cameras: where they start,
            or where they are and stay (``cameras_known``).
        warm: they come from such a fit: its widest robust scale has been passed.
    """
    weights, costs = scene.weights, list[float]()
    free = [] if cameras_known else [v for v in range(len(cameras.R)) if v != scene.reference]
    evidence = gather(scene.observations, scene.timeline)
    if options.objective != "single":
        evidence = replace(evidence, stray=first_strays(len(scene.observations), options))
    shared = consensus_motion(scene, state, cameras, options)
    terms = regularisers(scene.body, scene.prior, weights, scene.fps) + estimates_on_axis(
        scene.body, scene.observations, scene.timeline, shared.trans,
        evidence_mm=weights.evidence_mm * correlation_frames(options, scene.fps) ** 0.5,
    )  # fmt: skip
    lenses = NO_LENSES if cameras_known else lenses_of(scene)
    spread_m = np.zeros(evidence.weight.shape)
    status = ""
    for stage in ROBUST_STAGES[warm:]:
        progress(f"one motion for all views, robust scale {stage:g}x")
        scale = weights.robust_scale_sigma * stage
        shared, cameras, solution = fit_shared(
            scene.body, shared, with_spread(evidence, spread_m, scene, shared, cameras), cameras,
            free, terms, options, robust_scale=scale, lenses=lenses,
        )  # fmt: skip
        evidence = estimate_strays(
            scene.body, shared, evidence, cameras, options, robust_scale=scale
        )
        spread_m = spread_m_of(evidence, scene, shared, cameras)
        costs.append(solution.costs[-1])
        status = solution.status
    fit = misfit(scene, shared, cameras, evidence.stray)
    if evidence.stray is None:
        own = single_motion(scene, state, shared, cameras)
        return JointMotion(own, cameras, shared, costs, f"one motion for all: {status}", fit)
    progress("each video's own deviation")
    spread = Spread(spread_m, evidence.stray)
    state, cost = own_deviations(
        scene.through(cameras), state, shared, cameras, spread, options, warm=warm
    )
    return JointMotion(state, cameras, shared, [*costs, cost], f"shared motion {status}", fit)


def focal_px(cameras: Cameras) -> np.ndarray:
    """(M,) focal lengths."""
    found: np.ndarray = cameras.K[:, 0, 0].cpu().numpy()
    return found


def spread_m_of(
    evidence: Evidence, scene: Scene, shared: MotionState, cameras: Cameras
) -> np.ndarray:
    """(M, N, K) how far each keypoint strays from the common motion, metres."""
    errors = reprojection_errors_px(
        scene.body, shared, evidence, cameras, robust_scale=scene.weights.robust_scale_sigma
    )
    depth = depths_m(scene.body, shared, cameras)
    return keypoint_spread_m(
        errors, evidence.sigma_px, depth, focal_px(cameras), window=round(scene.fps / 2)
    )


def with_spread(
    evidence: Evidence, spread_m: np.ndarray, scene: Scene, shared: MotionState, cameras: Cameras
) -> Evidence:
    """Evidence whose noise holds how far a performance strays from the common one."""
    depth = depths_m(scene.body, shared, cameras)
    spread_px = spread_m * (focal_px(cameras)[:, None] / depth)[..., None]
    sigma2 = evidence.sigma_px[..., None] ** 2
    return replace(evidence, weight=evidence.weight * sigma2 / (sigma2 + spread_px**2))
