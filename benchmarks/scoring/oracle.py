"""What the same fitter makes of the same detections when correspondences and cameras are known.

The bound of every table: a synchronised, calibrated studio with this detector. Nothing but the
correspondences and the cameras is taken from the truth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, SmplBa, SyncMap
from imocap_core.artifacts.schemas.sync import SyncSummary
from imocap_core.io.truth import Truth
from imocap_core.metrics.sync import true_reference_frame
from imocap_core.motion.multiview.common import common_then_own
from imocap_core.motion.multiview.consensus import Cameras
from imocap_core.motion.multiview.joint import one_body, recover_motion
from imocap_core.motion.multiview.scene import JointMotion, Scene
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams, Params
from imocap_core.problem.motion import (
    LIKE,
    body_for,
    evidence_joints,
    observations_of,
    scene_of,
    smpl_ba_of,
    state_of,
)


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
    seen = observations_of(body, keypoints, camera_motion, params.fit, evidence_joints(initial))
    observations = [
        replace(o, K=_known(truth.videos[v.id].K, v.id))
        for o, v in zip(seen, keypoints.videos, strict=True)
    ]
    scene = scene_of(body, observations, sync, params.fit)
    cameras = true_cameras(sync, truth)
    motion = fit_with_cameras(scene, state_of(initial.videos), cameras, params.motion)
    return smpl_ba_of(body, motion, observations, keypoints, sync.reference), sync


def fit_with_cameras(
    scene: Scene, start: MotionState, cameras: Cameras, options: MotionParams
) -> JointMotion:
    """What `recover_motion` does once it has cameras, with cameras that stay as they are."""
    if len(scene.observations) == 1:
        return recover_motion(scene, start, options)
    return common_then_own(scene, one_body(start), cameras, options, cameras_known=True)


def true_sync(found: SyncSummary, truth: Truth) -> SyncSummary:
    """The true correspondences to the reference that was found; frames without any are NaN."""
    reference = _known(truth.videos[found.reference].phase, found.reference)
    used = np.arange(len(reference), dtype=np.float64)
    maps = []
    for video in found.ids:
        at = true_reference_frame(_known(truth.videos[video].phase, video), used, reference)
        trust = np.isfinite(at).astype(np.float64)
        maps.append(SyncMap(id=video, reference_frame=at, confidence=trust))
    told = {"maps": maps, "method": "none", "status": "true"}
    nothing: dict[str, object] = {"excluded": [], "mirrored": [], "notes": [], "trust": None}
    return found.model_copy(update=told | nothing)


def true_cameras(sync: SyncSummary, truth: Truth) -> Cameras:
    """The true cameras from the axes of the reference's."""
    at = truth.videos[sync.reference]
    R_ref, t_ref = _known(at.R, sync.reference), _known(at.t, sync.reference)
    R = [_known(truth.videos[v].R, v) @ R_ref.T for v in sync.ids]
    t = [_known(truth.videos[v].t, v) - turn @ t_ref for v, turn in zip(sync.ids, R, strict=True)]
    K = [_known(truth.videos[v].K, v) for v in sync.ids]
    return Cameras(*(torch.as_tensor(np.stack(x)).to(LIKE) for x in (R, t, K)))


def _known(value: np.ndarray | None, video: str) -> np.ndarray:
    if value is None:
        raise ValueError(f"truth: the oracle needs joints, K, R, t and phase of {video}")
    return value
