"""Bodies unlike the others', other people, sliding feet, and what bodies do not do.

Videos that seem to show different people, by their bones. Fitted with one body, a person with long
thighs has longer ones in the pictures than the fit, and a person with short ones shorter. A bone is
measured where it lies across the line of sight, left and right by themselves, relative to the other
bones: a body is alike on both sides, what a fit or a detector does wrong is not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.cluster.hierarchy import fcluster, linkage

from imocap_core.adapters.ground import ground_of, held_deg
from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    Keypoints,
    RefineSync,
    SmplBa,
    SyncSummary,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body.layouts import layout_names
from imocap_core.camera.gravity import lowest_heights_m, sole_heights_m
from imocap_core.camera.ground_plane import Ground
from imocap_core.conventions import EVAL_INDICES, LIMB_BONES, SIDES, SMPL_JOINTS
from imocap_core.diagnostics.contradictions import (
    LIMB_JOINTS,
    MeasuredSpan,
    forbidden_advice,
    frames_of,
    limbs_px,
    person_size,
    stretches,
)
from imocap_core.diagnostics.detection_findings import lost_cameras
from imocap_core.diagnostics.findings import Finding
from imocap_core.motion.multiview.timeline import values_at
from imocap_core.motion.state import mirrored_joints
from imocap_core.sequences import index_at, runs

LEAST_DIFFERENCE_M = 0.15  # twice the mean difference between performances of one action
USUAL_RATIO = 2.5  # times the action's median
LEAST_S = 0.3
GAP_S = 0.1
HIPS = [SMPL_JOINTS.index(name) for name in ("left_hip", "right_hip")]


@dataclass(frozen=True)
class PlacedBody:
    """One video's joints (T, 24, 3) in the world's axes, metres, and phases (T,), seconds."""

    joints: Float[np.ndarray, "T 24 3"]
    phase_s: Float[np.ndarray, " T"]
    fps: float


def outlying_bodies(bodies: Mapping[str, PlacedBody]) -> dict[str, list[MeasuredSpan]]:
    """Spans in which a video's body is far from the nearest of the others, and the mean distance
    in metres; by video."""
    nearest = nearest_distances(bodies)
    every = np.concatenate(list(nearest.values())) if nearest else np.zeros(0)
    every = every[np.isfinite(every)]
    if not len(every):
        return {video: [] for video in bodies}
    limit = max(LEAST_DIFFERENCE_M, USUAL_RATIO * float(np.median(every)))
    spans = {}
    for video, distance in nearest.items():
        fps = bodies[video].fps
        far = np.nan_to_num(distance) > limit
        spans[video] = [
            MeasuredSpan(a, b, float(np.nanmean(distance[a : b + 1])))
            for a, b in stretches(far, fps, LEAST_S, GAP_S)
        ]
    return spans


def nearest_distances(bodies: Mapping[str, PlacedBody]) -> dict[str, Float[np.ndarray, " _"]]:
    """Per frame of each video the mean joint distance, root-relative and in the world's axes, to
    the nearest other video at the same moment; NaN where no other shows it."""
    relative = {video: _root_relative(body.joints) for video, body in bodies.items()}
    nearest = {}
    for video, body in bodies.items():
        distance = np.full(len(body.phase_s), np.nan)
        for other, theirs in bodies.items():
            if other != video:
                poses = _at_phase(relative[other], theirs.phase_s, body.phase_s)
                mean = np.linalg.norm(relative[video] - poses, axis=-1).mean(-1)
                distance = np.fmin(distance, mean)
        nearest[video] = distance
    return nearest


def _root_relative(joints: Float[np.ndarray, "T 24 3"]) -> Float[np.ndarray, "T 12 3"]:
    return joints[:, EVAL_INDICES] - joints[:, HIPS].mean(1, keepdims=True)


def _at_phase(
    poses: Float[np.ndarray, "S 12 3"],
    phase_s: Float[np.ndarray, " S"],
    moments_s: Float[np.ndarray, " T"],
) -> Float[np.ndarray, "T 12 3"]:
    """Poses interpolated at moments; NaN outside of what the video shows."""
    index = index_at(phase_s, moments_s)
    inside = np.isfinite(index)[:, None, None]
    return np.where(inside, values_at(poses, np.nan_to_num(index)), np.nan)


ACROSS = 0.85  # of its length a bone must show
LEAST_FRAMES, LEAST_LIMBS, LEAST_VIDEOS = 15, 3, 2
# Two performers with bodies of their own, fitted as one: 0.089 and 0.156 apart, 5.5 and 5.8 times
# the difference of sides, groups 2.0 and 1.4 times as far apart as they are wide. One performer (26
# results, made and real detections): no more than 0.07 where the groups are farther apart than wide
LEAST_DIFFERENCE = 0.07
SIDES_APART, GROUPS_APART = 3.0, 1.2


def performer_findings(
    keypoints: Keypoints, camera_motion: CameraMotion | None, refined: RefineSync
) -> list[Finding]:
    """A proposal to declare two performers; nothing where they are declared."""
    if camera_motion is None or any(v.performer is not None for v in keypoints.videos):
        return []
    cameras = {camera.id: camera for camera in camera_motion.videos}
    motions = {motion.id: motion for motion in refined.motion.videos}
    K = {camera.id: camera.K for camera in refined.motion.cameras}
    videos = [v for v in keypoints.videos if v.id not in refined.sync.excluded]
    errors = [limb_errors(v, cameras[v.id], motions[v.id], K[v.id]) for v in videos]
    groups = two_bodies(np.array(errors).reshape(-1, len(LIMB_BONES), 2))
    if groups is None:
        return []
    first, second = (
        ", ".join(v.id for v, number in zip(videos, groups, strict=True) if number == g)
        for g in (groups[0], 1 - groups[0])
    )
    text = f"the limbs of {first} have other proportions than those of {second}"
    remedy = (
        f"if they show two people, write `performer: A` below the videos {first} and `performer: "
        f"B` below {second} in action.yaml, and each gets a body of its own"
    )
    return [Finding("remark", "", text, text, remedy)]


def limb_errors(
    video: VideoKeypoints,
    camera: VideoCameraMotion,
    motion: VideoMotion,
    K: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "4 2"]:
    """Median logarithm of detected over fitted length in the picture, by limb and side; NaN where
    it is seldom seen across."""
    names = layout_names(video.layout)
    out = np.full((len(LIMB_BONES), 2), np.nan)
    for row, limb in enumerate(LIMB_BONES):
        for column, side in enumerate(SIDES):
            ends = [f"{side}_{end}" for end in limb]
            if not set(ends) <= set(names):
                continue
            near, far = (motion.joints[:, SMPL_JOINTS.index(end)] for end in ends)
            shown = np.hypot(*(_pixels(far, K) - _pixels(near, K)).T)
            start, stop = (camera.xy_first_px[:, names.index(end)] for end in ends)
            detected = np.hypot(*(stop - start).T)
            full = K[0, 0] * np.linalg.norm(far - near, axis=-1) / np.minimum(near, far)[:, 2]
            used = (shown > ACROSS * full) & np.isfinite(detected) & (detected > 0)
            if used.sum() >= LEAST_FRAMES:
                out[row, column] = np.median(np.log(detected[used] / shown[used]))
    return out


def two_bodies(errors: Float[np.ndarray, "M 4 2"]) -> list[int] | None:
    """Of each video, which of two bodies (0, 1) it shows; None where nothing speaks for two."""
    limbs = np.isfinite(errors).all(axis=(0, 2))
    if len(errors) < 2 * LEAST_VIDEOS or limbs.sum() < LEAST_LIMBS:
        return None
    used = errors[:, limbs]
    used = used - used.mean(axis=(1, 2), keepdims=True)
    proportions = used.mean(axis=2)
    groups = fcluster(linkage(proportions, "complete"), 2, "maxclust") - 1
    a, b = (proportions[groups == g] for g in (0, 1))
    if min(len(a), len(b)) < LEAST_VIDEOS:
        return None
    difference = float(np.linalg.norm(a.mean(axis=0) - b.mean(axis=0)))
    sides = float(np.sqrt(((np.diff(used, axis=2)[..., 0] / 2) ** 2).mean(axis=0).sum()))
    width = max(_distances(a, a).max(), _distances(b, b).max())
    apart = _distances(a, b).min()
    clear = difference >= max(LEAST_DIFFERENCE, SIDES_APART * sides)
    return [int(g) for g in groups] if clear and apart >= GROUPS_APART * width else None


def _distances(a: Float[np.ndarray, "A n"], b: Float[np.ndarray, "B n"]) -> np.ndarray:
    return np.asarray(np.linalg.norm(a[:, None] - b[None], axis=-1))


def _pixels(points: Float[np.ndarray, "T 3"], K: Float[np.ndarray, "3 3"]) -> np.ndarray:
    projected = points @ K.T
    return projected[:, :2] / projected[:, 2:]


WINDOW_S = 0.1
STILL_SHARE = 0.012  # of the person's size, over the window
LEAST_SPEED_M_S = 1.0
LEAST_SLIDING_FRAMES = 2


def slides(
    ankle_m: Float[np.ndarray, "T 3"],
    ankle_px: Float[np.ndarray, "T 2"],
    size_px: float,
    fps: float,
) -> list[MeasuredSpan]:
    """Spans in which an ankle is still in the picture and fast in space, and its top speed, m/s.

    Args:
        ankle_m: in the axes of the video's first-frame camera.
        ankle_px: the detection, warped into the first frame; NaN where not detected.
        size_px: of the person.
    """
    step = max(1, round(WINDOW_S * fps))
    if len(ankle_m) <= step:
        return []
    speed = np.linalg.norm(ankle_m[step:] - ankle_m[:-step], axis=-1) * fps / step
    moved = np.linalg.norm(ankle_px[step:] - ankle_px[:-step], axis=-1) / size_px
    sliding = (speed > LEAST_SPEED_M_S) & (np.nan_to_num(moved, nan=np.inf) < STILL_SHARE)
    return [
        MeasuredSpan(first, last + step, float(speed[first : last + 1].max()))
        for first, last in runs(sliding, LEAST_SLIDING_FRAMES, step)
    ]


UNFIT = 0.05  # of the person's size: usual frames stay below 0.02, a detector's noise included
UNFIT_S = 0.3


def body_findings(
    motion: SmplBa, sync: SyncSummary, videos: Mapping[str, VideoKeypoints]
) -> list[Finding]:
    """Spans in which a body is far from those of all other videos at that moment."""
    phases = sync.phases
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
            f"the body is {1000 * span.value:.0f} mm a joint away from that of {others} at "
            "the same moment",
            "its body differs from the others",
            "compare its frames with the others' in `imocap view`, and if the timing is wrong, "
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
        for span in stretches(apart, video.fps, UNFIT_S, GAP_S):
            first, last = frames_of(video, *span)
            mean = float(np.nanmean(off[span[0] : span[1] + 1]))
            text = f"the body is {mean:.0%} of the person's size away from the detections"
            brief = "the body does not fit the picture"
            findings.append(Finding("body", video.id, text, brief, "", first, last))
    return findings


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
    lost, findings = lost_cameras(cameras), []
    for motion in motions:
        if motion.id in lost:
            continue
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
                        f"to {span.value:.1f} m/s in space",
                        "feet wrong in depth",
                        "",
                        *frames_of(video, span.first, span.last),
                    )
                )
    return findings


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
    rolls, sights = {}, {}
    for camera in motion.cameras:
        if camera.id in turned and camera.id not in sync.excluded:
            roll, down = held_deg(motion.ground.up, camera, turned[camera.id])
            if abs(down) < STEEP_DEG:
                rolls[camera.id], sights[camera.id] = abs(roll), camera.R[2]
    video = max(rolls, key=rolls.__getitem__, default="")
    # turned about a line of sight, up is wrong for all cameras along it (within 45 degrees)
    along = [rolls[u] for u in rolls if abs(sights[u] @ sights[video]) > 0.7]
    if video and rolls[video] > ROLLED_DEG and min(along) > ROLLED_DEG / 2:
        why = f"the camera of {video} would be rolled by {rolls[video]:.0f} degrees"
    elif motion.ground.tilt_sd_deg > TILT_SD_DEG:
        why = f"it is uncertain by {motion.ground.tilt_sd_deg:.0f} degrees"
    else:
        return []
    text = f"which way is up is doubtful: {why}; ground, heights and every export lean with it"
    return [Finding("up", "", text, why, subject="which way is up")]


def floor_findings(
    motion: SmplBa, sync: SyncSummary, cameras: Sequence[VideoCameraMotion]
) -> list[Finding]:
    """Videos whose performer stands below the floor, or never reaches it."""
    if motion.ground is None:
        return []
    ground, R_t = ground_of(motion.ground), {c.id: (c.R, c.t) for c in motion.cameras}
    unknown, findings = {*sync.excluded, *lost_cameras(cameras)}, []
    for video in motion.videos:
        if video.id in unknown:
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
    """How far the lower sole is below the ground at its lowest, and the lowest part of the body
    above it, each but for one frame of 20 and two standard deviations of the ground's height."""
    allowed = 2 * np.nan_to_num(ground.height_sd_mm, nan=np.inf)
    sole, part = (
        1000 * float(np.nanquantile(heights_m(joints, ground), 1 - OFTEN))
        for heights_m in (sole_heights_m, lowest_heights_m)
    )
    return -sole - allowed, part - allowed


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
                findings.append(
                    Finding(
                        "body",
                        motion.id,
                        f"a {joint} moves at {top:.0f} m/s, faster than people do",
                        "moves faster than people do",
                        "",
                        int(motion.frames[first]),
                        int(motion.frames[last + step]),
                    )
                )
    return findings


LEAP_M, LEAP_RATIO = 0.25, 2.0  # within a frame; to motion across the picture, and beside it


def leap_findings(motions: Sequence[VideoMotion]) -> list[Finding]:
    """Limbs that jump in depth from one frame to the next."""
    return [
        Finding(
            "body",
            motion.id,
            f"the {side} {limb} jumps by up to {far.max():.1f} m in depth within a frame",
            f"{side} {limb} jumps in depth",
            "",
            int(motion.frames[frames[0]]),
            int(motion.frames[frames[-1] + 1]),
        )
        for motion in motions
        for limb, side in product(LIMB_JOINTS, SIDES)
        for far in [_leaps_m(motion.joints, [f"{side}_{part}" for part in LIMB_JOINTS[limb]])]
        if len(frames := np.flatnonzero(far))
    ]


def _leaps_m(joints: Float[np.ndarray, "T 24 3"], names: Sequence[str]) -> Float[np.ndarray, " S"]:
    """Length of each frame's step in depth of any of some joints (camera axes); 0 for no jump."""
    columns = [SMPL_JOINTS.index(name) for name in names]
    step = np.diff(joints[:, columns] - joints[:, :1], axis=0)
    length = np.linalg.norm(step, axis=-1)
    beside = np.pad(length, ((1, 1), (0, 0)))
    other = np.maximum(np.linalg.norm(step[..., :2], axis=-1), np.maximum(beside[:-2], beside[2:]))
    return np.where((length > LEAP_M) & (length > LEAP_RATIO * other), length, 0.0).max(axis=1)
