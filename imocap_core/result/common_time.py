"""A result on the time axis that all its videos share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.motion.multiview.common_time import (
    FramePositions,
    common_grid,
    frame_positions,
    pose_at,
    values_at,
)
from imocap_core.result.body import body_model, local_rotations, posed_joints
from imocap_core.result.video import HandMotion, VideoMoment, VideoResult
from imocap_core.rotations import log


def on_common_time(videos: Sequence[VideoResult], fps: float) -> tuple[VideoResult, ...]:
    """Every video at the moments of one grid, `fps` of them per second of the reference.

    Where a video shows nothing of a moment it stands still in its nearest pose (`inside` is False
    there). Every video must have a place on the axis.
    """
    grid_s = common_grid([v.phase_s for v in videos], fps)
    return tuple(
        replace(_resampled(v, frame_positions(v.phase_s, grid_s), grid_s), fps=fps) for v in videos
    )


def at_phase(videos: Sequence[VideoResult], phase_s: float) -> dict[str, VideoMoment]:
    """The same moment in every video that shows it, by id."""
    moments = {}
    for video in videos:
        if not np.isfinite(video.phase_s).any():
            continue
        where = frame_positions(video.phase_s, np.array([phase_s]))
        if not where.inside[0]:
            continue
        shown = _resampled(video, where, np.array([phase_s]))
        frame = float(shown.frames[0])
        moments[video.id] = VideoMoment(
            index=float(where.position[0]),
            frame=frame,
            time_s=float(video.keypoints.seconds_of(shown.frames)[0]),
            joints=shown.joints[0],
            confidence=float(shown.confidence[0]),
        )
    return moments


def _resampled(
    video: VideoResult, m: FramePositions, phase_s: Float[np.ndarray, " N"]
) -> VideoResult:
    """A video at the fractional frames of the moments `phase_s`."""
    theta, trans = pose_at(video.theta, m.position), values_at(video.trans, m.position)
    model = body_model(video.model, video.action, hands=False)
    camera = video.camera
    turns = local_rotations(pose_at(_vectors(camera.R_first_from_frame), m.position))[:, 0]
    uncertain = video.joint_uncertainty
    return replace(
        video,
        theta=theta,
        trans=trans,
        body_joints=posed_joints(model, video.betas, theta, trans),
        hands=None if video.hands is None else _hands_at(video.hands, m),
        camera=replace(
            camera,
            R_first_from_frame=turns,
            zoom=values_at(camera.zoom, m.position),
            H_first_from_frame=values_at(camera.H_first_from_frame, m.position),
            path_m=None if camera.path_m is None else values_at(camera.path_m, m.position),
        ),
        joint_uncertainty=None
        if uncertain is None
        else replace(
            uncertain,
            sigma_mm=values_at(uncertain.sigma_mm, m.position),
            covariance_mm2=values_at(uncertain.covariance_mm2, m.position),
            rotation_covariance_deg2=values_at(uncertain.rotation_covariance_deg2, m.position),
        ),
        frames=values_at(video.frames.astype(np.float64), m.position),
        reprojection_px=values_at(video.reprojection_px, m.position),
        confidence=np.where(m.inside, values_at(video.confidence, m.position), 0.0),
        inside=m.inside,
        phase_s=phase_s,
    )


def _hands_at(hands: HandMotion, m: FramePositions) -> HandMotion:
    flat = np.concatenate([hands.wrists[:, :, None], hands.fingers], axis=2)
    turned = pose_at(flat.reshape(len(flat), -1), m.position).reshape(
        len(m.position), *flat.shape[1:]
    )
    return HandMotion(
        wrists=turned[:, :, 0],
        fingers=turned[:, :, 1:],
        points=values_at(hands.points, m.position),
        visible=hands.visible[np.round(m.position).astype(np.int64)] & m.inside[:, None],
    )


def _vectors(R: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3"]:
    """Axis-angle vectors, radians."""
    return log(torch.as_tensor(R)).numpy()
