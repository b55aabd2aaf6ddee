"""A video of variable frame rate at even moments: its keypoints, and its camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from imocap_core.artifacts.schemas import HandKeypoints, SourceMoments, VideoKeypoints
from imocap_core.camera.averaging import nearest_rotation
from imocap_core.camera.camera_motion import CameraMotionEstimate
from imocap_core.motion.multiview.timeline import values_at
from imocap_core.sequences import EvenMoments, even_moments, points_at_moments


def at_even_moments(
    video: VideoKeypoints, time_s: Float[np.ndarray, " T"] | None
) -> VideoKeypoints:
    """The keypoints at the moments of a constant rate; as they are when `time_s` is None.

    Args:
        time_s: presentation times of the used frames.
    """
    if time_s is None:
        return video
    moments = even_moments(time_s)
    first = int(video.frames[0])
    steps = np.diff(time_s)
    remark = (
        f"the frame rate varies ({1 / steps.max():.3g} to {1 / steps.min():.3g} frames/s): read by "
        f"time stamps at {moments.fps:.4g} moments/s"
    )
    body = _at_moments(video.xy_px, video.confidence, moments, time_s)
    hands = None
    if video.hands is not None:
        fingers = _at_moments(video.hands.xy_px, video.hands.confidence, moments, time_s)
        points, confidence = fingers[..., :2], np.nan_to_num(fingers[..., 2])
        hands = HandKeypoints(xy_px=points, confidence=confidence)
    return VideoKeypoints.model_validate(
        dict(video)
        | {
            "fps": moments.fps,
            "frames": first + moments.nearest,
            "xy_px": body[..., :2],
            "confidence": np.nan_to_num(body[..., 2]),
            "person_box_px": points_at_moments(video.person_box_px, moments, time_s),
            "note": f"{video.note}; {remark}",
            "hands": hands,
            "moments": SourceMoments(position=first + moments.position, time_s=moments.time_s),
        }
    )


def nearest_used(video: VideoKeypoints) -> Int[np.ndarray, " S"]:
    """Index of the used frame that is nearest to every source frame from the first used one to the
    last."""
    source = np.arange(video.frames[0], video.frames[-1] + 1)
    index = np.interp(source, video.source_frames, np.arange(len(video.frames)))
    return np.rint(index).astype(np.int64)


def camera_at_used_frames(
    camera: CameraMotionEstimate, video: VideoKeypoints
) -> CameraMotionEstimate:
    """A camera's motion, known in every source frame from the first used one to the last, at the
    used frames: between two where the frame rate is variable."""
    if video.moments is None:
        return camera
    position = video.source_frames - video.frames[0]
    return replace(
        camera,
        H_first_from_frame=values_at(camera.H_first_from_frame, position),
        R_first_from_frame=nearest_rotation(values_at(camera.R_first_from_frame, position)),
        zoom=values_at(camera.zoom, position),
        path=None if camera.path is None else values_at(camera.path, position),
        path_sd=None if camera.path_sd is None else values_at(camera.path_sd, position),
        inliers=camera.inliers[np.rint(position).astype(np.int64)],
    )


def _at_moments(
    xy_px: Float[np.ndarray, "T *points 2"],
    confidence: Float[np.ndarray, "T *points"],
    moments: EvenMoments,
    time_s: Float[np.ndarray, " T"],
) -> Float[np.ndarray, "N *points 3"]:
    """Places and confidences at the moments, NaN where nothing is detected."""
    detected = (confidence > 0)[..., None]
    points = np.where(detected, np.concatenate([xy_px, confidence[..., None]], axis=-1), np.nan)
    return points_at_moments(points, moments, time_s)
