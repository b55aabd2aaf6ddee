"""From an action's result to takes: joint trees, surfaces and cameras that formats can write."""

from __future__ import annotations

import numpy as np
import torch

from imocap_core.body import Model, Shaped, load_free_body
from imocap_core.body.conversions import rotations_from_pose
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed
from imocap_core.export.values import Performance, Result
from imocap_core.io.writers.clip_body import ClipCamera
from imocap_core.io.writers.motion_clip import MotionClip, bone_tips

WRISTS = SMPL_JOINTS.index("left_wrist")  # the right one follows; then joints that hands replace
STILL = 1e-9  # a camera that turns less stands


def body_of(result: Result, hands: bool) -> Model:
    """The body model that the result was made with, with fingers when `hands`."""
    body = load_free_body()
    if (body.name, body.digest) != (result.model, result.model_digest):
        raise WorkFailed(
            f"{result.action} was made with the body model {result.model} "
            f"({result.model_digest[:12]}), and this version has {body.name} ({body.digest[:12]}); "
            f"run it with: imocap run {result.action}"
        )
    return load_free_body(hands=True) if hands else body


def shaped_of(result: Result, p: Performance) -> Shaped:
    """The performer's body; with fingers where the video has hands."""
    return body_of(result, hands=p.hands is not None).shape(torch.as_tensor(p.betas))


def poses_of(p: Performance) -> np.ndarray:
    """Axis-angle poses (T, 72), or SMPL+H's (T, 156): up to the elbows the body's, then hands."""
    if p.hands is None:
        return p.body.theta
    parts = [p.body.theta[:, : 3 * WRISTS], p.hands.wrists, p.hands.fingers]
    return np.concatenate([part.reshape(len(p.frames), -1) for part in parts], axis=1)


def take_of(p: Performance, shaped: Shaped) -> MotionClip:
    """One performance as a joint tree in motion."""
    rest = shaped.joints_rest.numpy()
    return MotionClip(
        id=p.id,
        joint_names=shaped.model.joint_names,
        parents=shaped.model.parents,
        rest=rest - rest[0],
        tips=bone_tips(shaped),
        R_local=rotations_from_pose(torch.as_tensor(poses_of(p))).numpy(),
        pelvis=p.body.trans + rest[0],
        fps=p.fps,
        frames=p.frames,
        inside=p.inside,
        phase_s=p.phase_s,
    )


def camera_of(p: Performance) -> ClipCamera:
    """The camera that filmed it: in frame t x_frame = R_first_from_frame^T (R x_world + t)."""
    turning = np.abs(p.turns - np.eye(3)).max() > STILL
    turns = p.turns if turning else np.eye(3)[None]
    return ClipCamera(
        id=p.id,
        K=p.K,
        zoom=p.zoom if np.ptp(p.zoom) > STILL else p.zoom[:1],
        size=p.seen.size,
        R_cam_from_world=turns.swapaxes(1, 2) @ p.pose.R,
        centre=-p.pose.R.T @ p.pose.t,
    )
