"""What the same fitter makes of the same detections when correspondences and cameras are known.

The upper bound of every table: a synchronised, calibrated studio with this detector. Nothing but
the correspondences and the cameras is taken from the truth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, SmplBa, SyncMap
from imocap_core.artifacts.schemas.sync import SyncSummary
from imocap_core.formats.truth import Truth
from imocap_core.metrics.sync import true_reference_frame
from imocap_core.motion.consensus import Cameras
from imocap_core.motion.coupled import consensus_motion
from imocap_core.motion.deviation import keypoint_spread_m
from imocap_core.motion.joint import ROBUST_STAGES, misfit, one_body
from imocap_core.motion.monocular import regularisers
from imocap_core.motion.own import own_deviations
from imocap_core.motion.scene import JointMotion, JointOptions, Scene, solve
from imocap_core.motion.shared import depths_m, gather, reprojection_errors_px, views_of
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Reprojection
from stages.motion_values import (
    LIKE,
    body_for,
    evidence_joints,
    observations_of,
    options_of,
    scene_of,
    smpl_ba_of,
    state_of,
)
from stages.params import Params


def oracle(
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    found: SyncSummary,
    truth: Truth,
    params: Params,
) -> tuple[SmplBa, SyncSummary]:
    """The oracle's motion and its correspondences, with the reference video that was `found`."""
    sync = true_sync(found, truth)
    body = body_for(keypoints)
    seen = observations_of(body, keypoints, camera_motion, evidence_joints(initial))
    observations = [
        replace(o, K=_known(truth.videos[v.id].K, v.id))
        for o, v in zip(seen, keypoints.videos, strict=True)
    ]
    scene = scene_of(body, observations, sync, params.fit)
    cameras = true_cameras(sync, truth)
    options = options_of(params.motion)
    motion = fit_with_cameras(scene, state_of(initial.videos), cameras, options)
    return smpl_ba_of(body, motion, observations, keypoints, sync.reference), sync


def true_sync(found: SyncSummary, truth: Truth) -> SyncSummary:
    """The true correspondences to the reference that was found; frames without any are NaN."""
    reference = _known(truth.videos[found.reference].phase, found.reference)
    used = np.arange(len(reference), dtype=np.float64)
    maps = []
    for video in found.ids:
        at = true_reference_frame(_known(truth.videos[video].phase, video), used, reference)
        trust = np.isfinite(at).astype(np.float64)
        maps.append(SyncMap(id=video, reference_frame=at, confidence=trust))
    return found.model_copy(update={"maps": maps, "method": "none", "status": "true"})


def true_cameras(sync: SyncSummary, truth: Truth) -> Cameras:
    """The true cameras from the axes of the reference's."""
    at = truth.videos[sync.reference]
    R_ref, t_ref = _known(at.R, sync.reference), _known(at.t, sync.reference)
    R = [_known(truth.videos[v].R, v) @ R_ref.T for v in sync.ids]
    t = [_known(truth.videos[v].t, v) - turn @ t_ref for v, turn in zip(sync.ids, R, strict=True)]
    return Cameras(torch.as_tensor(np.stack(R)).to(LIKE), torch.as_tensor(np.stack(t)).to(LIKE))


def fit_with_cameras(
    scene: Scene, start: MotionState, cameras: Cameras, options: JointOptions
) -> JointMotion:
    """SMPL-BA's shared motion and own deviations while the cameras stay as they are.

    One video has nobody to share with: its monocular motion stands, as in `recover_motion`.
    """
    if len(scene.observations) == 1:
        return JointMotion(start, cameras, start, [], "one video: the monocular motion stands", 0.0)
    weights = scene.weights
    state = one_body(start)
    shared = consensus_motion(scene, state, cameras, options)
    evidence = gather(scene.observations, scene.timeline, noise_share=weights.noise_share)
    spread_m = np.zeros(evidence.weight.shape)
    costs = []
    for stage in ROBUST_STAGES:
        depth = depths_m(scene.body, shared, cameras)
        focal = evidence.K[:, 0, 0, None]
        spread_px = spread_m * (focal / depth)[..., None]
        sigma2 = evidence.sigma_px[..., None] ** 2
        seen = replace(evidence, weight=evidence.weight * sigma2 / (sigma2 + spread_px**2))
        views = views_of(seen, cameras, shared.trans, free=())
        terms = [
            Reprojection(scene.body, views, weights.robust_scale * stage),
            *regularisers(scene.prior, weights, scene.fps),
        ]
        solution = solve(terms, shared, options, one_body=False)
        shared = solution.state
        costs.append(solution.costs[-1])
        spread_m = keypoint_spread_m(
            reprojection_errors_px(scene.body, shared, evidence, cameras),
            evidence.sigma_px,
            depths_m(scene.body, shared, cameras),
            evidence.K[:, 0, 0],
            window=round(scene.fps / 2),
        )
    state, cost = own_deviations(scene, state, shared, cameras, spread_m, options)
    fit = misfit(scene, shared, cameras)
    return JointMotion(state, cameras, shared, [*costs, cost], "true cameras and frames", fit)


def _known(value: np.ndarray | None, video: str) -> np.ndarray:
    if value is None:
        raise ValueError(f"truth: the oracle needs joints, K, R, t and phase of {video}")
    return value
