"""Warnings of the detections, the people, the cameras, and what no video shows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.adapters.ground import SEEN
from imocap_core.artifacts.schemas import (
    Keypoints,
    PredictedVideo,
    SmplBa,
    SyncSummary,
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.body.layouts import layout_names
from imocap_core.diagnostics.contradictions import frames_of, stretches
from imocap_core.diagnostics.findings import Finding, frames_text, listed

MISSING_S = 0.5
SWAPPED_SHARE = 0.2  # of the frames: more says that the detector takes backs for fronts
LENS = " lens"  # in the parts of a camera's note that are about it
RIVAL_RATIO = 1.5  # of the performer's score to the next one's


def detection_findings(videos: Sequence[VideoKeypoints]) -> list[Finding]:
    """Long stretches without a person, cuts, swapped sides, other people."""
    return [f for video in videos for f in (*_missing(video), *_of_note(video))]


def camera_findings(cameras: Sequence[VideoCameraMotion]) -> list[Finding]:
    """Cameras that move from their place, with a path as a remark, without one as a warning; lenses
    that were corrected or should be."""
    lost = lost_cameras(cameras)
    moving = [
        _lost(camera) if camera.id in lost else _walks(camera)
        for camera in cameras
        if camera.motion == "translating"
    ]
    return moving + [finding for camera in cameras for finding in _lens(camera)]


def lost_cameras(cameras: Sequence[VideoCameraMotion]) -> set[str]:
    """Cameras that move on an unknown path: where their performer stands is not known either."""
    return {c.id for c in cameras if c.motion == "translating" and not len(c.path)}


def _lens(camera: VideoCameraMotion) -> list[Finding]:
    words = [part for part in camera.note.split("; ") if LENS in part]
    return [Finding("remark", camera.id, part, "the lens is not a pinhole") for part in words]


def _walks(camera: VideoCameraMotion) -> Finding:
    text = f"{camera.note}; the unit of its length is told by the performer's size and feet"
    return Finding("remark", camera.id, text, "the camera moves along a known path")


def _lost(camera: VideoCameraMotion) -> Finding:
    apart = f"the camera moves from its place, {camera.residual_px:.1f} px from a pure rotation"
    return Finding(
        "camera",
        camera.id,
        f"{camera.note or apart}; where its performer stands in the world is unreliable",
        "the camera moves",
        subject=f"the path of {camera.id}",
    )


def remarks(video: VideoKeypoints) -> list[str]:
    """The parts of a video's note on given tracks, swapped sides, a variable rate, and on how
    its file and keypoints were read."""
    parts = video.note.split("; ")
    kinds = (
        *("track ", "left and right", "the frame rate", "the time stamps"),
        *("the pixels", "the picture", "the keypoints"),
    )
    return [part for part in parts if part.startswith(kinds)]


def _missing(video: VideoKeypoints) -> list[Finding]:
    nobody = np.asarray((video.confidence > 0).sum(axis=1) == 0)
    return [
        Finding(
            "detection",
            video.id,
            f"nobody is detected for {(b - a + 1) / video.fps:.1f} s; the motion there is a guess",
            "nobody detected",
            "",
            *frames_of(video, a, b),
        )
        for a, b in stretches(nobody, video.fps, MISSING_S)
    ]


def _of_note(video: VideoKeypoints) -> list[Finding]:
    findings = []
    for part in remarks(video):
        count = re.match(r"left and right .* in (\d+) frames", part)
        if count is None:
            findings.append(Finding("remark", video.id, part, part))
        elif int(count[1]) > SWAPPED_SHARE * len(video.frames):
            text = f"the detector swapped left and right of a limb {count[1]} times (undone)"
            text += "; it may have taken the back for the front elsewhere"
            findings.append(Finding("detection", video.id, text, "left and right uncertain"))
    rival = re.search(r"scores ([\d.]+) times the next", video.note)
    if rival is not None and float(rival[1]) < RIVAL_RATIO:
        text = "another person in the picture scores nearly as high as the one that was followed"
        advice = (
            "`imocap people` lists everybody, `person: {track: 2}` in action.yaml takes the second"
        )
        findings.append(Finding("remark", video.id, text, "another person", advice))
    return findings


def left_out_findings(keypoints: Keypoints) -> list[Finding]:
    """Each video that was left out when it was read, with the fault."""
    return [
        Finding(
            "decision",
            video.id,
            f"left out, the result is that of the other videos: {video.reason}",
            f"left out: {video.reason}",
            f"mend it or remove {video.id} from action.yaml",
        )
        for video in keypoints.left_out or ()
    ]


def damage_findings(keypoints: Keypoints) -> list[Finding]:
    """Each span of a video that could not be decoded."""
    return [
        Finding(
            "detection",
            video.id,
            "the video file is damaged, its keypoints are not used, the motion there is a guess",
            "the video file is damaged",
            "get the video again",
            first,
            last,
        )
        for video in keypoints.videos
        for first, last in video.damaged or ()
    ]


# Performances of one action differ by some 50 mm; for two cameras whose lines of sight differ by
# this angle, that is 150 mm along them
ONE_LINE_DEG, _ACROSS_DEG = 20.0, 45.0  # from the latter on they look across each other
_DIFFERENCE = 0.03  # 50 mm as a share of the height
HIDDEN_S = 0.5  # a hand moves by half a metre in this time
WHOLE = 0.9  # of the frames
LIMB_ENDS = {
    "left hand": ("left_wrist", "left_shoulder"),
    "right hand": ("right_wrist", "right_shoulder"),
    "left foot": ("left_ankle", "left_hip"),
    "right foot": ("right_ankle", "right_hip"),
}
"""Of each limb its end, and the joint of the trunk that it hangs on."""


def view_findings(
    motion: SmplBa, sync: SyncSummary, predicted: Sequence[PredictedVideo]
) -> list[Finding]:
    """That depth is a guess where all videos look along one line: the less performances agree, the
    wider an angle they need."""
    used = sync.used
    widest = widest_angle_deg(sight_lines(motion, used))
    missed = [p.error_share for p in predicted if p.error_share > 0] or [0.0]  # NaN is not
    ratio = max(1.0, float(np.median(missed)) / _DIFFERENCE)
    one_line, across = np.sin(np.radians([ONE_LINE_DEG, _ACROSS_DEG]))
    if np.sin(np.radians(widest)) >= min(ratio * one_line, across):
        return []
    which = "both look" if len(used) == 2 else "all of them look"
    text = f"{which} along one line (within {max(1.0, widest):.0f} degrees): depth is a guess"
    if len(used) == 1:
        text = "one video shows everything from one side, and depth is a guess"
    return [Finding("view", "", text, "depth is a guess")]


def sight_lines(motion: SmplBa, used: Sequence[str]) -> Float[np.ndarray, "M 3"]:
    """Mean unit vectors from each camera to its performer, in the world's axes."""
    R = {camera.id: camera.R for camera in motion.cameras}
    lines = []
    for video in motion.videos:
        if video.id in used:
            root = video.joints[:, 0]
            mean = np.nanmean(root / np.linalg.norm(root, axis=-1, keepdims=True), axis=0)
            lines.append(mean @ R[video.id])
    return np.array(lines) / np.linalg.norm(lines, axis=-1, keepdims=True)


def widest_angle_deg(lines: Float[np.ndarray, "M 3"]) -> float:
    """Largest angle between two lines, whichever way they run: 0 to 90."""
    return float(np.degrees(np.arccos(np.clip(np.abs(lines @ lines.T), 0, 1)).max()))


def hidden_findings(sync: SyncSummary, videos: Mapping[str, VideoKeypoints]) -> list[Finding]:
    """Limbs that no video shows for a while, at the moments of the reference."""
    reference = videos[sync.reference]
    hidden = hidden_limbs(sync, videos)
    spans: dict[tuple[int, int], list[str]] = {}
    for name, flags in zip(LIMB_ENDS, hidden.T, strict=True):
        for span in stretches(flags, reference.fps, HIDDEN_S, 0.1):
            alike = next((s for s in spans if _common(s, span) > 0.7), span)
            spans.setdefault(alike, []).append(name)
    return [_hidden(names, span, reference) for span, names in spans.items()]


def _hidden(names: list[str], span: tuple[int, int], reference: VideoKeypoints) -> Finding:
    first, last = frames_of(reference, *span)
    whole = span[1] - span[0] + 1 >= WHOLE * len(reference.frames)
    when = "" if whole else f" in {reference.id} {frames_text(first, last)}"
    them = "it" if len(names) == 1 else "them"
    limbs = _together(names)
    return Finding(
        "hidden",
        "",
        f"no video shows {limbs}{when or ' for most of the time'}; what the body does with {them} "
        "is a guess",
        f"no video shows {them}",
        subject=f"{limbs}{when}",
    )


def _together(names: list[str]) -> str:
    """'the left hand', 'both hands and the left foot'."""
    words = []
    for part, both in (("hand", "both hands"), ("foot", "both feet")):
        sides = [name for name in names if name.endswith(part)]
        words += [both] if len(sides) == 2 else [f"the {name}" for name in sides]
    return listed(words)


def hidden_limbs(
    sync: SyncSummary, videos: Mapping[str, VideoKeypoints]
) -> Bool[np.ndarray, "N 4"]:
    """Whether no video sees a limb's end while one sees the trunk, at each frame of the
    reference."""
    count = len(videos[sync.reference].frames)
    end, trunk = np.zeros((2, len(LIMB_ENDS), count))
    for sync_map in sync.maps:
        if sync_map.id in sync.excluded:
            continue
        video = videos[sync_map.id]
        position = sync_map.reference_frame
        if sync_map.id == sync.reference:
            position = np.arange(count, dtype=float)
        other = sync_map.id in sync.mirrored
        for k, joints in enumerate(LIMB_ENDS.values()):
            for into, joint in zip((end, trunk), joints, strict=True):
                visible = _confidence(video, _other_side(joint) if other else joint)
                into[k] = np.maximum(into[k], _at_reference(visible, position, count))
    return np.asarray(((end < SEEN) & (trunk >= SEEN)).T)


def _confidence(video: VideoKeypoints, joint: str) -> Float[np.ndarray, " T"]:
    names = layout_names(video.layout)
    if joint not in names:
        return np.ones(len(video.frames))  # not asked for
    return np.asarray(video.confidence[:, names.index(joint)])


def _at_reference(
    confidence: Float[np.ndarray, " T"], position: Float[np.ndarray, " T"], count: int
) -> Float[np.ndarray, " N"]:
    """Confidence at each frame of the reference; 0 beyond what the video shows."""
    matched = np.flatnonzero(np.isfinite(position))
    if not len(matched):
        return np.zeros(count)
    order = matched[np.argsort(position[matched], kind="stable")]
    return np.interp(np.arange(count), position[order], confidence[order], left=0.0, right=0.0)


def _other_side(joint: str) -> str:
    side, rest = joint.split("_")
    return f"{'right' if side == 'left' else 'left'}_{rest}"


def _common(a: tuple[int, int], b: tuple[int, int]) -> float:
    """Length of two spans' intersection over that of their union."""
    inside = min(a[1], b[1]) - max(a[0], b[0]) + 1
    return inside / (max(a[1], b[1]) - min(a[0], b[0]) + 1)
