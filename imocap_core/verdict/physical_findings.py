"""What bodies and cameras do not do: a rolled camera, soles off the floor, impossible speeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import (
    SmplBa,
    SyncSummary,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.camera.ground import sole_heights_m
from imocap_core.camera.ground_plane import Ground
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.problem.ground import ground_of, held_deg
from imocap_core.runs import runs
from imocap_core.verdict.findings import Finding

ROLLED_DEG = 15.0  # people hold cameras level within a few degrees
STEEP_DEG = 60.0  # pitch beyond which roll says nothing
TILT_SD_DEG = 10.0  # of up: a body of this lean falls over
OFF_FLOOR_MM = 100.0  # of the lower sole, beyond the ground's own error
OFTEN = 0.95  # of the frames
# m/s. Pitchers' and servers' hands reach some 25, kickers' feet 25, sprinters 12
FASTEST = {"wrist": 30.0, "elbow": 20.0, "ankle": 30.0, "knee": 20.0, "pelvis": 13.0, "head": 15.0}
SPEED_S = 1 / 15  # over which a speed is measured


def up_findings(
    motion: SmplBa, sync: SyncSummary, cameras: Sequence[VideoCameraMotion]
) -> list[Finding]:
    """Up that would have a camera rolled, or that is uncertain: the worse reason."""
    if motion.ground is None:
        return []
    turned = {camera.id: camera for camera in cameras}
    rolls = {}
    for camera in motion.cameras:
        if camera.id in turned and camera.id not in sync.excluded:
            roll, down = held_deg(motion.ground.up, camera, turned[camera.id])
            rolls[camera.id] = abs(roll) if abs(down) < STEEP_DEG else 0.0
    video = max(rolls, key=rolls.__getitem__, default="")
    if video and rolls[video] > ROLLED_DEG:
        why = f"the camera of {video} would be rolled by {rolls[video]:.0f} degrees"
    elif motion.ground.tilt_sd_deg > TILT_SD_DEG:
        why = f"it is uncertain by {motion.ground.tilt_sd_deg:.0f} degrees"
    else:
        return []
    text = f"which way is up is doubtful: {why}; ground, heights and every export lean with it"
    return [Finding("up", "", text, why, subject="which way is up")]


def floor_findings(motion: SmplBa, sync: SyncSummary) -> list[Finding]:
    """Videos whose performer stands below the floor, or never reaches it."""
    if motion.ground is None:
        return []
    ground, R_t = ground_of(motion.ground), {c.id: (c.R, c.t) for c in motion.cameras}
    findings = []
    for video in motion.videos:
        if video.id in sync.excluded:
            continue
        R, t = R_t[video.id]
        low, high = floor_misses_mm((video.joints - t) @ R, ground)
        off, where = max((low, "below the floor"), (high, "above the floor"))
        if off > OFF_FLOOR_MM:
            findings.append(
                Finding(
                    "body",
                    video.id,
                    f"the soles are {off:.0f} mm or more {where}, beyond its own error: the pose "
                    "is wrong in depth, or the place",
                    f"soles {where}",
                )
            )
    return findings


def floor_misses_mm(joints: Float[np.ndarray, "T 24 3"], ground: Ground) -> tuple[float, float]:
    """How far the lower sole is below the ground at its lowest, and above it at its lowest, each
    but for one frame of 20 and two standard deviations of the ground's height."""
    lower = 1000 * sole_heights_m(joints, ground)
    allowed = 2 * np.nan_to_num(ground.height_sd_mm, nan=np.inf)
    lowest = float(np.nanquantile(lower, 1 - OFTEN))
    return -lowest - allowed, lowest - allowed


def speed_findings(
    motions: Sequence[VideoMotion], videos: Mapping[str, VideoKeypoints]
) -> list[Finding]:
    """Joints faster than anybody moves them."""
    findings = []
    for motion in motions:
        fps = videos[motion.id].fps
        step = max(1, round(SPEED_S * fps))
        moved = np.linalg.norm(motion.joints[step:] - motion.joints[:-step], axis=-1)
        speed = moved * fps / step
        for joint, most in FASTEST.items():
            columns = [k for k, name in enumerate(SMPL_JOINTS) if name.endswith(joint)]
            fastest = speed[:, columns].max(axis=1, initial=0.0)
            for first, last in runs(np.nan_to_num(fastest) > most, 1, 2 * step):
                top = float(fastest[first : last + 1].max())
                frames = motion.frames[first], motion.frames[last + step]
                findings.append(
                    Finding(
                        "body",
                        motion.id,
                        f"a {joint} moves at {top:.0f} m/s, faster than people do",
                        "moves faster than people do",
                        "",
                        int(frames[0]),
                        int(frames[1]),
                    )
                )
    return findings
