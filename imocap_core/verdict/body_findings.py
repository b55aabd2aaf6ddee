"""Bodies unlike the others', and sliding feet, named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import (
    Camera,
    SmplBa,
    SyncSummary,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.mirror import mirrored_joints
from imocap_core.runs import runs
from imocap_core.verdict.advice import forbidden_advice
from imocap_core.verdict.findings import Finding
from imocap_core.verdict.limbs import limbs_px
from imocap_core.verdict.outlying_body import PlacedBody, outlying_bodies
from imocap_core.verdict.person_size import person_size
from imocap_core.verdict.sliding_feet import slides

UNFIT = 0.05  # of the person's size: usual frames stay below 0.02, a detector's noise included
UNFIT_S = 0.3


def body_findings(
    motion: SmplBa, sync: SyncSummary, videos: Mapping[str, VideoKeypoints]
) -> list[Finding]:
    """Spans in which a body is far from those of all other videos at that moment."""
    phases = {} if sync.trust is None else {v.id: v.phase_s for v in sync.trust.videos}
    cameras = {camera.id: camera for camera in motion.cameras}
    bodies = {
        v.id: PlacedBody(
            placed_joints(v, cameras[v.id], v.id in sync.mirrored), phases[v.id], videos[v.id].fps
        )
        for v in motion.videos
        if v.id in phases and v.id not in sync.excluded
    }
    others = "every other video" if len(bodies) > 2 else "the other video"
    return [
        Finding(
            "body",
            video,
            f"the body is {1000 * span.distance_m:.0f} mm a joint away from that of {others} at "
            "the same moment",
            "its body differs from the others",
            "compare them with `imocap view`, and if the timing is wrong, "
            + forbidden_advice(video, first, last),
            first,
            last,
        )
        for video, spans in outlying_bodies(bodies).items()
        if len(bodies) > 2 or video != sync.reference
        for span in spans
        for first, last in [frames_of(videos[video], span.first, span.last)]
    ]


def picture_findings(
    motions: Sequence[VideoMotion], videos: Mapping[str, VideoKeypoints]
) -> list[Finding]:
    """Spans in which the body is not where the detections are."""
    findings = []
    for motion in motions:
        video = videos[motion.id]
        off = motion.reprojection_px / person_size(limbs_px(video))
        apart = np.nan_to_num(off) > UNFIT
        for span in runs(apart, max(2, round(UNFIT_S * video.fps)), round(0.1 * video.fps)):
            first, last = frames_of(video, *span)
            mean = float(np.nanmean(off[span[0] : span[1] + 1]))
            text = f"the body is {mean:.0%} of the person's size away from the detections"
            brief = "the body does not fit the picture"
            findings.append(Finding("body", video.id, text, brief, "", first, last))
    return findings


def frames_of(video: VideoKeypoints, first: int, last: int) -> tuple[int, int]:
    """Source frames of two indices."""
    return int(video.frames[first]), int(video.frames[last])


def placed_joints(
    motion: VideoMotion, camera: Camera, mirrored: bool
) -> Float[np.ndarray, "T 24 3"]:
    """Joints in the world's axes, metres; those of a mirrored video as the others see them."""
    world = (motion.joints - camera.t) @ camera.R
    return mirrored_joints(world) if mirrored else world


def feet_findings(
    motions: Sequence[VideoMotion],
    videos: Mapping[str, VideoKeypoints],
    cameras: Sequence[VideoCameraMotion],
) -> list[Finding]:
    """Feet that stand still in the picture and move in space."""
    warped = {camera.id: camera.xy_first_px for camera in cameras}
    findings = []
    for motion in motions:
        video = videos[motion.id]
        names, size = layout_names(video.layout), person_size(limbs_px(video))
        xy = warped.get(video.id, video.xy_px)
        for side in ("left", "right"):
            ankle = f"{side}_ankle"
            if ankle not in names:
                continue
            joint, column = SMPL_JOINTS.index(ankle), names.index(ankle)
            for span in slides(motion.joints[:, joint], xy[:, column], size, video.fps):
                findings.append(
                    Finding(
                        "feet",
                        video.id,
                        f"the {side} foot stands still in the picture, but the body's moves at up "
                        f"to {span.speed_m_s:.1f} m/s in space",
                        "feet wrong in depth",
                        "",
                        int(video.frames[span.first]),
                        int(video.frames[span.last]),
                    )
                )
    return findings
