"""Events of a video: foot contacts, fastest moments of joints, turning points of angles."""

from __future__ import annotations

import numpy as np

from imocap_core.biomechanics.events import (
    angle_events,
    foot_contact_events,
    foot_contacts,
    speed_events,
    speed_spreads_m_s,
)
from imocap_core.biomechanics.motion_event import MotionEvent
from imocap_core.conventions import SIDES, SMPL_JOINTS
from imocap_core.result.video import VideoResult
from imocap_core.result.video_angles import VideoAngles

FAST_JOINTS = ("pelvis", "head") + tuple(
    f"{side}_{joint}" for joint in ("wrist", "elbow", "knee", "ankle") for side in SIDES
)
FOOT = ("ankle", "foot")
AXIS = {"x": 0, "y": 1, "z": 2}


def video_events(video: VideoResult, angles: VideoAngles, up: str = "y") -> list[MotionEvent]:
    """The events of a video in a levelled world, whose axis `up` points up, in their order.

    angles: of the video.
    """
    paths = {joint: video.joint(joint) for joint in FAST_JOINTS}
    events = [
        *_contacts(video, up),
        *speed_events(paths, video.fps, _speed_spreads(video, paths)),
        *angle_events(angles.angles_deg, angles.sd_deg),
    ]
    return sorted(events, key=lambda event: event.index)


def contact_events(video: VideoResult, up: str = "y") -> list[MotionEvent]:
    """Where contacts of the feet begin and end, in their order."""
    return sorted(_contacts(video, up), key=lambda event: event.index)


def contact_frames(video: VideoResult) -> dict[str, list[tuple[int, int]]]:
    """First and last frame of every contact of each foot, by side."""
    return foot_contacts(*_feet(video, "y"), video.fps)


def _speed_spreads(video: VideoResult, paths_m: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Standard deviations of joints' speeds, m/s; none where the stage uncertainty has not run."""
    covariance = video.covariance_mm2
    if covariance is None:
        return {}
    return {
        joint: speed_spreads_m_s(path, covariance[:, SMPL_JOINTS.index(joint)], video.fps)
        for joint, path in paths_m.items()
    }


def _contacts(video: VideoResult, up: str) -> list[MotionEvent]:
    return foot_contact_events(*_feet(video, up), video.fps)


def _feet(video: VideoResult, up: str) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Ankle and ball of each foot (T, 2, 3), and the height of the lower one (T,); by side."""
    feet: dict[str, np.ndarray] = {
        side: video.body_joints[:, [SMPL_JOINTS.index(f"{side}_{joint}") for joint in FOOT]]
        for side in SIDES
    }
    heights = {side: np.asarray(p[..., AXIS[up]].min(axis=1)) for side, p in feet.items()}
    return feet, heights
