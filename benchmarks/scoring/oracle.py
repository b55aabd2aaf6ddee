"""The oracle: the same fitter on the same detections with true correspondences and cameras.

It is the bound of every table: a synchronised, calibrated studio with this detector. Only
correspondences and cameras are taken from the truth.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
import torch

from imocap_core.adapters.joint import problem_of
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, SmplBa, SyncMap
from imocap_core.artifacts.schemas.sync_schemas import SyncSummary
from imocap_core.io.truth import Truth
from imocap_core.metrics.sync import true_reference_frame
from imocap_core.motion.multiview.scene import Cameras, JointMotion, Scene
from imocap_core.motion.multiview.smpl_ba import (
    common_then_deviations,
    recover_motion,
    shared_shapes,
)
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams, Params

Value = TypeVar("Value")


def oracle(
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    estimated_sync: SyncSummary,
    truth: Truth,
    params: Params,
) -> tuple[SmplBa, SyncSummary]:
    """The oracle's motion and its correspondences, to the reference video of `estimated_sync`."""
    sync = true_sync(estimated_sync, truth)
    problem = problem_of(keypoints, camera_motion, initial, sync, params.fit, params.motion)
    cameras = true_cameras(sync, truth)
    scene = problem.scene.with_intrinsics(cameras)
    motion = fit_with_cameras(scene, problem.start, cameras, params.motion)
    return replace(problem, scene=scene).result(motion), sync


def fit_with_cameras(
    scene: Scene, start: MotionState, cameras: Cameras, options: MotionParams
) -> JointMotion:
    """The steps of `recover_motion` after its first cameras, with cameras that stay fixed.

    How many metres they are apart tells size as pictures tell proportions, and has its weight.
    """
    if len(scene.observations) == 1:
        return recover_motion(scene, start, options)
    scene = replace(scene, fit=replace(scene.fit, size_prior=scene.fit.shape_prior))
    return common_then_deviations(
        scene, shared_shapes(start, scene.performers), cameras, options, cameras_known=True
    )


def true_sync(estimated: SyncSummary, truth: Truth) -> SyncSummary:
    """The true correspondences to the estimate's reference video; NaN for frames without any."""
    reference = _required(truth.videos[estimated.reference].phase, estimated.reference)
    frames = np.arange(len(reference), dtype=np.float64)
    maps = []
    for video in estimated.ids:
        phase = _required(truth.videos[video].phase, video)
        reference_frame = true_reference_frame(phase, frames, reference)
        confidence = np.isfinite(reference_frame).astype(np.float64)
        maps.append(SyncMap(id=video, reference_frame=reference_frame, confidence=confidence))
    true = {"maps": maps, "method": "none", "status": "true"}
    nothing: dict[str, object] = {"excluded": [], "mirrored": [], "notes": [], "trust": None}
    return estimated.model_copy(update=true | nothing)


def true_cameras(sync: SyncSummary, truth: Truth) -> Cameras:
    """The true cameras from the axes of the reference camera."""
    reference = truth.videos[sync.reference]
    R_ref, t_ref = _required(reference.R, sync.reference), _required(reference.t, sync.reference)
    R = [_required(truth.videos[v].R, v) @ R_ref.T for v in sync.ids]
    t = [_required(truth.videos[v].t, v) - R_v @ t_ref for v, R_v in zip(sync.ids, R, strict=True)]
    K = [_required(truth.videos[v].K, v) for v in sync.ids]
    return Cameras(*(torch.as_tensor(np.stack(x)) for x in (R, t, K)))


def _required(value: Value | None, video: str) -> Value:
    if value is None:
        raise ValueError(f"truth of {video}: the oracle needs joints, K, R, t and phase")
    return value
