"""Limbs that a detector sees where the recovered body has them elsewhere, or hides them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.artifacts.schemas import PredictedVideo, SmplBa, VideoCameraMotion, VideoKeypoints
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.diagnostics.findings import Finding
from imocap_core.sequences import runs

LIMBS = tuple(
    f"{side}_{joint}"
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in ("left", "right")
)
TWINS = mirror_indices(LIMBS)


def limbs_px(video: VideoKeypoints) -> Float[np.ndarray, "T 12 2"]:
    """Detections (T, 12, 2) of shoulders to ankles; NaN where there are none."""
    names = layout_names(video.layout)
    xy = np.full((len(video.frames), len(LIMBS), 2), np.nan)
    for k, name in enumerate(LIMBS):
        if name in names:
            column = names.index(name)
            there = video.confidence[:, column] > 0
            xy[there, k] = video.xy_px[there, column]
    return xy


def person_size(xy: Float[np.ndarray, "T K 2"]) -> float:
    """Diagonal of the keypoints' bounding box, as large as in one frame of ten; NaN if none."""
    complete = np.isfinite(xy).all(axis=(1, 2))
    if not complete.any():
        present = np.isfinite(xy).all(-1).sum(1) >= 2
        if not present.any():
            return float("nan")
        complete = present
    span = np.nanmax(xy[complete], axis=1) - np.nanmin(xy[complete], axis=1)
    return float(np.quantile(np.hypot(*span.T), 0.9))


@dataclass(frozen=True)
class MeasuredSpan:
    """Frames `first` to `last` (indices, both within), and what was measured in them."""

    first: int
    last: int
    value: float


def stretches(
    flags: Bool[np.ndarray, " T"], fps: float, least_s: float, gap_s: float = 0.0
) -> list[tuple[int, int]]:
    """First and last index of each stretch of at least so long, and two frames; those that at most
    `gap_s` separate are one."""
    return runs(flags, max(2, round(least_s * fps)), round(gap_s * fps))


def frames_of(video: VideoKeypoints, first: int, last: int) -> tuple[int, int]:
    """Source frames of two indices."""
    return int(video.frames[first]), int(video.frames[last])


def anchor_advice(video: str, reference: str) -> str:
    """How to tell the program which frames belong together."""
    return (
        "name frames that show the same moment in action.yaml, as in "
        f"`anchors: [{{{reference}: FRAME, {video}: FRAME}}]`"
    )


def forbidden_advice(video: str, first_frame: int, last_frame: int) -> str:
    """How to leave frames out of the matching."""
    span = f"[{first_frame}, {last_frame + 1}]"
    return f"leave these out with `forbidden: [{{video: {video}, frames: {span}}}]`"


SEEN = 0.5  # confidence of a detection that says where a joint is
AWAY = 0.15  # of the person's size, of the farthest joint of a limb
LEAST_S, GAP_S = 0.15, 0.07
VISIBILITY = ("blazepose33", "mediapipe33")  # whose confidence says that nothing is in front
CLEAR = 0.7  # confidence of a joint in front of everything; hidden ones have below 0.5
BEHIND_M = 0.12  # a trunk's half depth: farther behind its middle, a joint is hidden
ACROSS = 0.4  # cosine between the trunk's normal and the line of sight
LEAST_HIDDEN_S = 0.06
TRUNK = [
    SMPL_JOINTS.index(f"{side}_{joint}")
    for side, joint in (
        ("left", "shoulder"),
        ("right", "shoulder"),
        ("right", "hip"),
        ("left", "hip"),
    )
]  # in turn around it
LIMB_JOINTS = {"arm": ("elbow", "wrist"), "leg": ("knee", "ankle")}


def contradicted_findings(
    motion: SmplBa, videos: Mapping[str, VideoKeypoints], cameras: Sequence[VideoCameraMotion]
) -> list[Finding]:
    """The stretches in which the motion does not follow the detector: the other videos, or what a
    body can do, overruled it."""
    filmed = {camera.id: camera for camera in cameras if not len(camera.path)}
    K = {camera.id: camera.K for camera in motion.cameras}
    findings = []
    for body in (body for body in motion.videos if body.id in filmed):
        video, xy = videos[body.id], filmed[body.id].xy_first_px
        pixels = body.joints @ K[body.id].T
        away = _distances(pixels[..., :2] / pixels[..., 2:], video, xy)
        findings += [
            Finding(
                "detection",
                body.id,
                f"the {name} is detected elsewhere than the motion has it, up to "
                f"{away[first : last + 1, k].max():.0%} of the person's size away",
                f"{name} detected elsewhere",
                "look at it in `imocap view`; keypoints that are wrong count for nothing at "
                "confidence 0",
                *frames_of(video, first, last),
            )
            for k, name in enumerate(_names())
            for first, last in stretches(away[:, k] > AWAY, video.fps, LEAST_S, GAP_S)
        ]
    return findings


def behind_findings(motion: SmplBa, videos: Mapping[str, VideoKeypoints]) -> list[Finding]:
    """Hands and elbows that are seen clearly, and that the body has behind its trunk; of detectors
    that tell what is hidden."""
    findings = []
    for body in motion.videos:
        video = videos[body.id]
        if video.layout not in VISIBILITY:
            continue
        names = layout_names(video.layout)
        for side in ("left", "right"):
            hidden = np.zeros(len(video.frames), dtype=bool)
            depth_m = np.zeros(len(video.frames))
            for joint in (f"{side}_{part}" for part in LIMB_JOINTS["arm"]):
                if joint in names:
                    behind = behind_trunk_m(body.joints, SMPL_JOINTS.index(joint))
                    clear = video.confidence[:, names.index(joint)] >= CLEAR
                    hidden |= clear & (behind > BEHIND_M)
                    depth_m = np.maximum(depth_m, behind)
            findings += [
                Finding(
                    "body",
                    body.id,
                    f"the {side} arm is seen clearly, but the body has it up to "
                    f"{depth_m[first : last + 1].max():.1f} m behind the trunk, where it would be "
                    "hidden",
                    f"{side} arm wrong in depth",
                    "",
                    *frames_of(video, first, last),
                )
                for first, last in stretches(hidden, video.fps, LEAST_HIDDEN_S, GAP_S)
            ]
    return findings


def behind_trunk_m(joints: Float[np.ndarray, "T 24 3"], joint: int) -> Float[np.ndarray, " T"]:
    """How far a joint lies behind the trunk's plane along its line of sight (camera axes); 0 where
    it is beside the trunk in the picture, or the trunk is seen from its edge."""
    corners, point = joints[:, TRUNK], joints[:, joint]
    flat, position = corners[..., :2] / corners[..., 2:], point[:, :2] / point[:, 2:]
    edge, off = np.roll(flat, -1, axis=1) - flat, position[:, None] - flat
    turn = edge[..., 0] * off[..., 1] - edge[..., 1] * off[..., 0]
    inside = (turn > 0).all(axis=1) | (turn < 0).all(axis=1)
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    distance = np.linalg.norm(point, axis=-1)
    slope = (point * normal).sum(axis=-1) / distance
    across = np.abs(slope) > ACROSS
    plane = (corners.mean(axis=1) * normal).sum(axis=-1) / np.where(across, slope, 1.0)
    return np.where(inside & across, np.maximum(distance - plane, 0.0), 0.0)


def _names() -> list[str]:
    return [f"{side} {limb}" for side in ("left", "right") for limb in LIMB_JOINTS]


def _distances(
    body_px: Float[np.ndarray, "T 24 2"], video: VideoKeypoints, xy_px: Float[np.ndarray, "T K 2"]
) -> Float[np.ndarray, "T 4"]:
    """How far a limb's joints are detected from the body's, in sizes of the person: the farthest of
    those seen; 0 where none is."""
    names, size = layout_names(video.layout), person_size(limbs_px(video))
    away = np.zeros((len(video.frames), len(_names())))
    for k, name in enumerate(_names()):
        side, limb = name.split()
        for joint in (f"{side}_{joint}" for joint in LIMB_JOINTS[limb]):
            if joint in names:
                column = names.index(joint)
                offset = xy_px[:, column] - body_px[:, SMPL_JOINTS.index(joint)]
                distance = np.linalg.norm(offset, axis=-1) / size
                confident = (video.confidence[:, column] >= SEEN) & np.isfinite(distance)
                away[:, k] = np.maximum(away[:, k], np.where(confident, distance, 0.0))
    return away


FAR = 0.1  # median error, of the height: as long as a hand
WORSE = 2.0  # times the error of limbs hidden from the video's own monocular fit
PREDICTED = 0.05  # median error, of the height, and share of the keypoints within `FAR`
PREDICTED_SHARE = 0.9


def predicted_videos(predicted: Sequence[PredictedVideo]) -> frozenset[str]:
    """Videos whose pictures the others' motion predicts: their matches are right."""
    return frozenset(
        p.id for p in predicted if p.error_share <= PREDICTED and p.near_share >= PREDICTED_SHARE
    )


def prediction_findings(predicted: Sequence[PredictedVideo]) -> list[Finding]:
    """One finding per video that is predicted badly, the worst first."""
    # Python's max keeps the first of two where the second is NaN
    bad = [p for p in predicted if p.error_share > max(FAR, WORSE * p.monocular_error_share)]
    return [
        Finding(
            "body",
            p.id,
            f"the other videos' motion predicts its keypoints to {p.error_share:.0%} of the height "
            f"only, {p.near_share:.0%} of them within 10 %: the timing, the pose in depth or the "
            "action differs",
            "not predicted by the others",
            "compare its frames with the others' in `imocap view`",
        )
        for p in sorted(bad, key=lambda p: -p.error_share)
    ]
