"""What a person sees in a clip, as ranges of quantities of the result.

Frames are source frame numbers, both ends within. A fact without frames is one number a video.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult

Ground = Mapping[str, Mapping[str, float]]  # video -> column of the ground's table -> value
Curve = Float[np.ndarray, " T"]
STATISTICS: dict[str, Callable[[Curve], float]] = {
    "min": lambda x: float(np.min(x)),
    "max": lambda x: float(np.max(x)),
    "median": lambda x: float(np.median(x)),
}
SIDES = ("left", "right")
NO_FACTS: Mapping[str, Any] = {}


@dataclass(frozen=True)
class CheckedFact:
    """A fact, what the result has instead, and whether that is within the fact's range."""

    name: str
    value: float
    right: bool


def check_facts(
    truth: Mapping[str, Any], result: ActionResult, ground: Ground, treated: Mapping[str, str]
) -> list[CheckedFact]:
    """Every fact of a set: which videos are treated how, the synchronisation, and measures.

    Args:
        truth: the set's entry of `truth.yaml`. treated: of videos that are excluded or mirrored.
    """
    facts = []
    if "treated" in truth:
        wrong = {
            v for v in {*treated, *truth["treated"]} if treated.get(v) != truth["treated"].get(v)
        }
        facts.append(CheckedFact("treated", float(len(wrong)), not wrong))
    errors = sync_errors_frames(truth, result)
    if len(errors):
        mean = float(np.nanmean(errors))
        facts.append(CheckedFact("sync", mean, mean <= truth.get("sync_within", 1)))
    for fact in truth.get("facts", ()):
        low, high = fact["range"]
        value = fact_value(fact, result, ground)
        facts.append(CheckedFact(fact["measure"], value, low <= value <= high))
    return facts


def fact_value(fact: Mapping[str, Any], result: ActionResult, ground: Ground) -> float:
    """The measured quantity, by the fact's statistic over its frames."""
    measure, video = fact["measure"], str(fact.get("video"))
    if measure in ("roll_deg", "pitch_down_deg", "sole_depth_mm"):
        return ground[video][measure]
    if measure == "camera_yaw_apart_deg":
        return camera_yaw_apart_deg(result)
    if measure == "trunk_from_horizontal_deg":
        result = result.levelled("y")
    curve = CURVES[measure](result[video])
    first, last = fact["frames"]
    frames = np.floor(np.asarray(result[video].frames))
    return STATISTICS[fact.get("stat", "median")](curve[(frames >= first) & (frames <= last)])


def sync_errors_frames(truth: Mapping[str, Any], result: ActionResult) -> Curve:
    """Errors of matches with the reference at marked events, or of all under a known offset.

    Events that recur in no fixed order (`cyclic_events`) match the nearest of the reference's.
    """
    reference, errors = result.reference, list[float]()
    others = [v for v in result.ids if v != reference]
    matched = {v: _matched_frame(result, v) for v in others}
    for events in truth.get("events", NO_FACTS).values():
        right = np.atleast_1d(events.get(reference, []))
        for v in others:
            ours = np.atleast_1d(events.get(v, []))[: len(right)]
            errors += [abs(matched[v](f) - g) for f, g in zip(ours, right, strict=False)]
    if "offset" in truth:
        offset = truth["offset"]
        for v in others:
            frames, to_reference = _matches(result, v)
            errors += np.abs(to_reference - frames - offset[v] + offset[reference]).tolist()
    for events in truth.get("cyclic_events", NO_FACTS).values():
        right = np.atleast_1d(events.get(reference, []))
        for v in others if len(right) else ():
            position = np.array([matched[v](f) for f in np.atleast_1d(events.get(v, []))])
            position = position[
                (position >= right[0] - CYCLE_MARGIN) & (position <= right[-1] + CYCLE_MARGIN)
            ]
            errors += np.abs(position[:, None] - right).min(axis=1).tolist()
    return np.array(errors)


CYCLE_MARGIN = 8  # frames before the reference's first and after its last event that are compared


def _matches(result: ActionResult, video: str) -> tuple[Curve, Curve]:
    """Frames of a video that are matched, and the reference's frames at these moments."""
    matches = result.sync.matches(video, result.reference)
    frames = np.asarray(result[video].frames, dtype=float)
    finite = np.isfinite(matches.frame)
    return frames[finite], matches.frame[finite]


def _matched_frame(result: ActionResult, video: str) -> Callable[[float], float]:
    """The reference's frame at a frame of a video; NaN where no frame is matched."""
    frames, to_reference = _matches(result, video)
    if not len(frames):
        return lambda _: float("nan")
    return lambda frame: float(np.interp(frame, frames, to_reference))


def camera_yaw_apart_deg(result: ActionResult) -> float:
    """Angle between the first two cameras' lines of sight, seen from above."""
    level = result.levelled("y")
    ahead = [level[v].camera.R[2] for v in result.ids[:2]]
    first, second = (np.degrees(np.arctan2(a[0], a[2])) for a in ahead)
    return float(abs((first - second + 180) % 360 - 180))


def knee_flexion_deg(video: VideoResult) -> Curve:
    """Of the leg that is bent more; 0 is straight."""
    bent = []
    for side in SIDES:
        thigh = _unit(_joint(video, f"{side}_hip") - _joint(video, f"{side}_knee"))
        shank = _unit(_joint(video, f"{side}_ankle") - _joint(video, f"{side}_knee"))
        bent.append(180 - np.degrees(np.arccos(np.clip((thigh * shank).sum(-1), -1, 1))))
    return np.max(bent, axis=0)


def knees_ahead_m(video: VideoResult) -> Curve:
    """How much nearer to the camera the knees are than the hips, in the mean of both legs."""
    depth = {
        name: (_joint(video, name) @ video.camera.R.T + video.camera.t)[:, 2]
        for name in (f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee"))
    }
    ahead = [depth[f"{side}_hip"] - depth[f"{side}_knee"] for side in SIDES]
    return np.asarray(np.mean(ahead, axis=0))


def trunk_from_horizontal_deg(video: VideoResult) -> Curve:
    """Elevation of the line from pelvis to neck, in a world with y up."""
    trunk = _unit(_joint(video, "neck") - _joint(video, "pelvis"))
    return np.asarray(np.abs(np.degrees(np.arcsin(np.clip(trunk[:, 1], -1, 1)))))


def wrists_to_head_mm(video: VideoResult) -> Curve:
    """Distance of the farther wrist from the head."""
    away = [_joint(video, f"{side}_wrist") - _joint(video, "head") for side in SIDES]
    return 1000 * np.linalg.norm(away, axis=-1).max(axis=0)


def wrists_apart_mm(video: VideoResult) -> Curve:
    """Distance between the wrists."""
    apart = _joint(video, "left_wrist") - _joint(video, "right_wrist")
    return np.asarray(1000 * np.linalg.norm(apart, axis=-1))


def right_wrist_ahead_m(video: VideoResult) -> Curve:
    """How far the right wrist is in front of the chest."""
    across = _joint(video, "left_shoulder") - _joint(video, "right_shoulder")
    front = _unit(np.cross(across, _joint(video, "neck") - _joint(video, "pelvis")))
    reach = _joint(video, "right_wrist") - _joint(video, "spine3")
    return np.asarray((reach * front).sum(-1))


def right_wrist_speed_m_s(video: VideoResult) -> Curve:
    """Speed between each frame and the one before; 0 in the first."""
    steps = np.diff(_joint(video, "right_wrist"), axis=0)
    return np.concatenate([[0.0], np.linalg.norm(steps, axis=-1) * video.fps])


CURVES: dict[str, Callable[[VideoResult], Curve]] = {
    f.__name__: f
    for f in (
        knee_flexion_deg,
        knees_ahead_m,
        trunk_from_horizontal_deg,
        wrists_to_head_mm,
        wrists_apart_mm,
        right_wrist_ahead_m,
        right_wrist_speed_m_s,
    )
}


def _joint(video: VideoResult, name: str) -> Float[np.ndarray, "T 3"]:
    return np.asarray(video.joints[:, list(video.joint_names).index(name)])


def _unit(x: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T 3"]:
    return np.asarray(x / np.linalg.norm(x, axis=-1, keepdims=True))
