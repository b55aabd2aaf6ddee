"""Videos of one event: what their calibration claims, and whether undeclared ones look like one."""

from __future__ import annotations

import numpy as np

from imocap_core.artifacts.schemas import EventCameras, Keypoints, RefineSync
from imocap_core.motion.event.clock import clock_of
from imocap_core.verdict.findings import Finding, listed

ONE_OFFSET_S = 0.04  # of nine tenths of a video's matches from one offset
ONE_PATH_M = 0.007  # deviation of each video's path from the common one
UNCERTAIN_S = 0.1


def event_sentence(event: EventCameras, fps: float, left_out: int = 0) -> str:
    """How well the videos of one event are synchronised and their cameras calibrated.

    Args:
        fps: of the reference; left_out: the number of videos that could not be used.
    """
    ids = [camera.id for camera in event.cameras]
    count = f"{len(ids)} of {len(ids) + left_out} videos" if left_out else f"{len(ids)} videos"
    offset_s = max(camera.offset_sd_s for camera in event.cameras)
    turned = max(camera.rotation_sd_deg for camera in event.cameras)
    focal = max(camera.focal_sd for camera in event.cameras)
    lens = f"; focal lengths to {focal:.0%}" if focal > 0 else ""
    doubt = "The timing is doubtful: " if offset_s > UNCERTAIN_S else ""
    return (
        f"{doubt}{count} of one event are synchronised to about {1000 * offset_s:.0f} ms "
        f"({offset_s * fps:.1f} frames), and their cameras are calibrated from the performer: "
        f"directions to about {turned:.1f} degrees{lens}."
    )


def event_findings(keypoints: Keypoints, refined: RefineSync) -> list[Finding]:
    """A remark where the videos were not declared one event and look like one."""
    sync, common = refined.sync, refined.motion.common
    if refined.event is not None or common is None or len(common.ids) < 2:
        return []
    if float(common.rigid_offset_sd[:, 3:].max()) > ONE_PATH_M:
        return []
    used = [k for k, i in enumerate(sync.ids) if i not in sync.excluded]
    maps, videos = [sync.maps[k] for k in used], [keypoints.videos[k] for k in used]
    clock = clock_of(
        [m.reference_frame for m in maps],
        [m.confidence for m in maps],
        [video.fps for video in videos],
        [m.id for m in maps].index(sync.reference),
    )
    apart = []
    for v, (m, video) in enumerate(zip(maps, videos, strict=True)):
        matched = np.isfinite(m.reference_frame)
        away = np.arange(len(matched)) - clock.rate[v] * m.reference_frame - clock.offset[v]
        if not matched.any() or not np.isfinite(clock.offset[v]):
            return []
        apart.append(float(np.quantile(np.abs(away[matched]), 0.9)) / video.fps)
    if max(apart) > ONE_OFFSET_S:
        return []
    return [
        Finding(
            "remark",
            "",
            f"{listed([m.id for m in maps])} keep one offset to each other within "
            f"{1000 * max(apart):.0f} ms, as videos of one event do: if they film one and the same "
            "performance, event: true in action.yaml calibrates the cameras by it",
            "may be one event",
        )
    ]
