"""From a video's result to a motion clip: the joint tree and the camera that formats can write."""

from __future__ import annotations

import numpy as np

from imocap_core.body import Shaped
from imocap_core.io.writers.clip_body import ClipCamera
from imocap_core.io.writers.motion_clip import MotionClip, bone_tips
from imocap_core.result.camera import STILL
from imocap_core.result.video import VideoResult


def clip_of(video: VideoResult, shaped: Shaped) -> MotionClip:
    """One video's motion as a joint tree in motion."""
    rest = shaped.joints_rest.numpy()
    return MotionClip(
        id=video.id,
        joint_names=shaped.model.joint_names,
        parents=shaped.model.parents,
        rest=rest - rest[0],
        tips=bone_tips(shaped),
        R_local=video.rotations,
        pelvis=video.trans + rest[0],
        fps=video.fps,
        frames=video.frames.astype(np.float64),
        inside=video.inside,
        phase_s=video.phase_s,
    )


def camera_of(video: VideoResult) -> ClipCamera:
    """The camera that filmed it, with one rotation and one zoom where it is static."""
    camera = video.camera
    turning = np.abs(camera.R_first_from_frame - np.eye(3)).max() > STILL
    return ClipCamera(
        id=video.id,
        K=camera.K,
        zoom=camera.zoom if np.ptp(camera.zoom) > STILL else camera.zoom[:1],
        size=camera.size,
        R_cam_from_world=camera.R_per_frame if turning else camera.R[None],
        centre=camera.centre[None] if camera.path_m is None else camera.centre_per_frame,
    )
