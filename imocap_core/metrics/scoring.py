"""All metrics of one video as rows of a table, with the reason where one cannot be scored."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int, Real
from scipy.ndimage import gaussian_filter1d

from imocap_core.conventions import EVAL_12, EVAL_14, EVAL_17, SMPL_JOINTS
from imocap_core.metrics import position, sync, trajectory
from imocap_core.metrics import trajectory as camera
from imocap_core.metrics.position import (
    HIPS,
    hip_midpoint,
    missing_joints,
    root_relative,
    select_joints,
)
from imocap_core.metrics.whole_body import (
    BONE_AT_REST,
    aligned_joint_errors_mm,
    direction_errors_deg,
    rotation_errors_deg,
)

ALL_VIDEOS = "all videos"
JOINT_SETS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("", EVAL_12),
    ("_14", EVAL_14),
    ("_17", EVAL_17),
    ("_24", SMPL_JOINTS),
)
POSITION_METRICS = {
    "mpjpe_mm": position.mpjpe_mm,
    "mpjpe_scaled_mm": position.mpjpe_scaled_mm,
    "pa_mpjpe_mm": position.pa_mpjpe_mm,
}
MOTION_METRICS = (
    "acceleration_error_m_s2",
    "smoothed_truth_acceleration_error_m_s2",
    "root_path_error_mm",
    "root_path_aligned_error_mm",
    "foot_sliding_mm_s",
    "planted_foot_speed_mm_s",
    "true_planted_foot_speed_mm_s",
)
POSE_METRICS = (
    *(
        name.replace("mpjpe", f"mpjpe{suffix}")
        for suffix, _ in JOINT_SETS
        for name in POSITION_METRICS
    ),
    *MOTION_METRICS,
)
SYNC_METRICS = (
    "sync_error_pct",
    "sync_error_released_pct",
    "sync_error_frames",
    "sync_error_ms",
    "sync_median_error_frames",
    "offset_frames",
    "offset_error_frames",
    "matched_share",
    "false_match_share",
)
NO_OFFSET = "the timing of the clips differs by more than an offset"
NONE_MATCHED = "no matched frame has a counterpart in the reference clip"
MEDIAN_OVER_VIDEOS = frozenset({"offset_error_frames"})
"""Metrics whose summary over videos is the median; all others take the unweighted mean."""


@dataclass(frozen=True)
class ScoreRow:
    """One metric of one video, or the reason why it cannot be scored (value None).

    Attributes:
        result: the stage that is scored: "monocular", "single pass", "after loop".
        metric: ends in its unit; docs/metrics.md defines it.
        note: the reason why there is no value.
    """

    result: str
    video: str
    metric: str
    value: float | None
    note: str = ""


@dataclass(frozen=True)
class CameraJoints:
    """Joints of one video in the axes of its camera, at source frame numbers; predicted or true."""

    joints_m: Float[np.ndarray, "T J 3"]
    names: tuple[str, ...]
    frames: Int[np.ndarray, " T"]


def pose_rows(
    result: str, video: str, predicted: CameraJoints, true: CameraJoints, fps: float
) -> list[ScoreRow]:
    """Position, acceleration, root path and foot sliding of one video."""
    predicted, true = _on_common_frames(predicted, true)
    rows: list[ScoreRow] = []
    for suffix, wanted in JOINT_SETS:
        missing = _missing_note(predicted, true, (*wanted, *HIPS))
        for name, metric in POSITION_METRICS.items():
            label = name.replace("mpjpe", f"mpjpe{suffix}")
            if missing:
                rows.append(ScoreRow(result, video, label, None, missing))
                continue
            pair = (root_relative(m.joints_m, m.names, wanted) for m in (predicted, true))
            rows.append(scored_row(result, video, label, metric(*pair), "no frame has both"))
    return rows + _motion_rows(result, video, predicted, true, fps)


def _motion_rows(
    result: str, video: str, predicted: CameraJoints, true: CameraJoints, fps: float
) -> list[ScoreRow]:
    """Metrics of the motion from frame to frame: acceleration, root path, feet."""
    missing = _missing_note(predicted, true, EVAL_12)
    if missing:
        return [ScoreRow(result, video, name, None, missing) for name in MOTION_METRICS]
    roots = [hip_midpoint(m.joints_m, m.names) for m in (predicted, true)]
    relative = [root_relative(m.joints_m, m.names, EVAL_12) for m in (predicted, true)]
    ankles = [EVAL_12.index("left_ankle"), EVAL_12.index("right_ankle")]
    feet, true_feet = (r[:, ankles] + o[:, None] for r, o in zip(relative, roots, strict=True))
    contact = trajectory.foot_contacts(true_feet, fps)
    rough, feet_note = gaussian_filter1d(relative[1], 1.0, axis=0), "no foot stands"
    fast = (
        position.acceleration_error_m_s2(x, relative[1], true.frames, fps)
        for x in (relative[0], rough)
    )
    pairs = (
        *((value, "no three frames in a row") for value in fast),
        (trajectory.root_path_error_mm(*roots), "no frame has both"),
        (trajectory.root_path_aligned_error_mm(*roots), "too few frames"),
        (trajectory.foot_sliding_mm_s(feet, contact, fps, true_feet_m=true_feet), feet_note),
        (trajectory.planted_foot_speed_mm_s(feet, contact, fps), feet_note),
        (trajectory.planted_foot_speed_mm_s(true_feet, contact, fps), feet_note),
    )
    return _scored(result, video, MOTION_METRICS, pairs)


def sync_rows(
    result: str,
    video: str,
    matched_reference_frame: Real[np.ndarray, " T"],
    frames: Real[np.ndarray, " T"],
    phase: Real[np.ndarray, " T"],
    reference_frames: Real[np.ndarray, " T_ref"],
    reference_phase: Real[np.ndarray, " T_ref"],
    phase_end: float,
    reference_fps: float,
) -> list[ScoreRow]:
    """Synchronisation errors of one video that is not the reference; see `sync.sync_errors`."""
    errors = sync.sync_errors(
        matched_reference_frame, phase, reference_frames, reference_phase, phase_end
    )
    true_frame = sync.true_reference_frame(phase, reference_frames, reference_phase)
    constant = sync.is_offset(true_frame, frames)
    offset = sync.offset_frames(matched_reference_frame, frames) if constant else math.nan
    no_offset = NONE_MATCHED if constant else NO_OFFSET
    pairs = (
        (sync.sync_error_pct(errors), NONE_MATCHED),
        (
            sync.sync_error_released_pct(errors),
            "no frame shares its phase with a frame of the reference",
        ),
        (sync.sync_error_frames(errors), NONE_MATCHED),
        (sync.sync_error_ms(errors, reference_fps), NONE_MATCHED),
        (sync.sync_median_error_frames(errors), NONE_MATCHED),
        (offset, no_offset),
        (abs(offset - sync.offset_frames(true_frame, frames)), no_offset),
        (sync.matched_share(errors), "no frame has a counterpart"),
        (sync.false_match_share(errors), "every frame has a counterpart"),
    )
    return _scored(result, video, SYNC_METRICS, pairs)


def camera_row(
    result: str,
    video: str,
    R_cam_from_world: Float[np.ndarray, "3 3"],
    R_ref_from_world: Float[np.ndarray, "3 3"],
    R_cam_from_true_world: Float[np.ndarray, "3 3"],
    R_ref_from_true_world: Float[np.ndarray, "3 3"],
) -> ScoreRow:
    """Rotation error of one camera other than the reference."""
    error = camera.camera_rotation_error_deg(
        R_cam_from_world, R_ref_from_world, R_cam_from_true_world, R_ref_from_true_world
    )
    return scored_row(result, video, "camera_rotation_error_deg", float(error), "not recovered")


def reprojection_rows(
    result: str,
    video: str,
    points_cam_m: Float[np.ndarray, "T J 3"],
    K: Float[np.ndarray, "3 3"],
    xy_px: Float[np.ndarray, "T J 2"],
    confidence: Float[np.ndarray, "T J"],
    person_height_px: float,
) -> list[ScoreRow]:
    """Reprojection error of the keypoints, in pixels and in per cent of the person's height."""
    errors = camera.reprojection_errors_px(points_cam_m, K, xy_px, confidence)
    mean = round(camera.reprojection_error_px(errors, confidence), 9)  # the rest is rounding
    return [
        scored_row(result, video, "reprojection_px", mean, "nothing was detected"),
        scored_row(
            result, video, "reprojection_pct", 100 * mean / person_height_px, "nothing was detected"
        ),
    ]


def over_videos(rows: Sequence[ScoreRow]) -> list[ScoreRow]:
    """One summary row per result and metric, unweighted over the videos that could be scored."""
    groups: dict[tuple[str, str], list[ScoreRow]] = {}
    for row in rows:
        groups.setdefault((row.result, row.metric), []).append(row)
    return [_summary(group) for group in groups.values()]


def means_over_videos(rows: Sequence[ScoreRow]) -> dict[str, float]:
    """Metric -> its summary over the videos, of one result's rows; unscored metrics are absent."""
    return {row.metric: row.value for row in over_videos(rows) if row.value is not None}


def _summary(group: Sequence[ScoreRow]) -> ScoreRow:
    values = [row.value for row in group if row.value is not None]
    head = replace(group[0], video=ALL_VIDEOS)
    if not values:
        notes = dict.fromkeys(row.note for row in group if row.note)
        return replace(head, value=None, note="; ".join(notes))
    over = np.median if head.metric in MEDIAN_OVER_VIDEOS else np.mean
    partly = "" if len(values) == len(group) else f"{len(values)} of {len(group)} videos scored"
    return replace(head, value=float(over(values)), note=partly)


def scored_row(result: str, video: str, metric: str, value: float, if_nan: str) -> ScoreRow:
    """One metric; without a value, and with the reason `if_nan`, where it is not finite."""
    if math.isfinite(value):
        return ScoreRow(result, video, metric, float(value))
    return ScoreRow(result, video, metric, None, if_nan)


def _scored(
    result: str, video: str, metrics: Sequence[str], pairs: Iterable[tuple[float, str]]
) -> list[ScoreRow]:
    """Several metrics, each with its value and the reason where that is not finite."""
    return [scored_row(result, video, m, *p) for m, p in zip(metrics, pairs, strict=True)]


def _missing_note(predicted: CameraJoints, true: CameraJoints, wanted: Sequence[str]) -> str:
    """Which of the wanted joints truth or result lacks; empty when both have all."""
    for who, motion in (("the truth", true), ("the result", predicted)):
        absent = missing_joints(motion.names, wanted)
        if absent:
            return f"{who} has no {', '.join(absent)}"
    return ""


def _on_common_frames(a: CameraJoints, b: CameraJoints) -> tuple[CameraJoints, CameraJoints]:
    """Both motions at the source frames that both have."""
    common, in_a, in_b = np.intersect1d(a.frames, b.frames, return_indices=True)
    return (
        CameraJoints(a.joints_m[in_a], a.names, common),
        CameraJoints(b.joints_m[in_b], b.names, common),
    )


WORLD_METRICS = ("w_mpjpe_mm", "wa_mpjpe_mm", "rte_pct")
MPJAE = "mpjae_deg"
SEGMENT_METRICS = {
    "pelvis_rotation_error_deg": "pelvis",
    "chest_rotation_error_deg": "spine3",
    "head_rotation_error_deg": "head",
}
BONE_METRICS = {
    "neck_direction_error_deg": ("neck",),
    "collars_direction_error_deg": ("left_collar", "right_collar"),
}
SURFACE_METRICS = ("pve_mm", "pa_pve_mm", "foot_sliding_mm")
STRETCHED = "stretched_edges_pct"
JITTER = "jitter_10m_s3"
BODY_METRICS = (
    MPJAE,
    *SEGMENT_METRICS,
    *BONE_METRICS,
    *SURFACE_METRICS,
    *WORLD_METRICS,
    JITTER,
    STRETCHED,
)


def aligned_errors_mm(predicted: CameraJoints, true: CameraJoints) -> dict[str, float]:
    """SMPL joint -> mean error after alignment on the twelve joints; joints that both have.

    Empty when one of the twelve is missing.
    """
    predicted, true = _on_common_frames(predicted, true)
    if _missing_note(predicted, true, EVAL_12):
        return {}
    both = [name for name in SMPL_JOINTS if name in predicted.names and name in true.names]
    errors = aligned_joint_errors_mm(
        select_joints(predicted.joints_m, predicted.names, both),
        select_joints(true.joints_m, true.names, both),
        anchors=[both.index(name) for name in EVAL_12],
    )
    return dict(zip(both, errors.tolist(), strict=True))


def world_rows(
    result: str, video: str, predicted: CameraJoints, true: CameraJoints
) -> list[ScoreRow]:
    """W-MPJPE and WA-MPJPE of the 24 joints (of twelve where the truth lacks others), and RTE."""
    predicted, true = _on_common_frames(predicted, true)
    note = _missing_note(predicted, true, EVAL_12)
    if note:
        return [ScoreRow(result, video, metric, None, note) for metric in WORLD_METRICS]
    joints = EVAL_12 if missing_joints(true.names, SMPL_JOINTS) else SMPL_JOINTS
    pair = [select_joints(m.joints_m, m.names, joints) for m in (predicted, true)]
    roots = [hip_midpoint(m.joints_m, m.names) for m in (predicted, true)]
    complete = np.isfinite(pair[0] + pair[1]).all(axis=(1, 2))
    pair, roots = [x[complete] for x in pair], [x[complete] for x in roots]
    values = (
        (trajectory.w_mpjpe_mm(*pair), "no frame has both"),
        (trajectory.wa_mpjpe_mm(*pair), "no frame has both"),
        (trajectory.rte_pct(*roots), "the true root does not move"),
    )
    return _scored(result, video, WORLD_METRICS, values)


def segment_rows(
    result: str,
    video: str,
    predicted: Mapping[str, Float[np.ndarray, "T 3 3"]],
    true: Mapping[str, Float[np.ndarray, "T 3 3"]],
) -> list[ScoreRow]:
    """Errors of pelvis, chest and head, and of where neck and collars point, in camera axes."""
    rows = []
    for metric, joint in SEGMENT_METRICS.items():
        value, note = np.nan, f"the truth has no rotation of {joint}"
        if joint in true:
            value = float(np.nanmean(rotation_errors_deg(predicted[joint], true[joint])))
        rows.append(scored_row(result, video, metric, value, note))
    for metric, joints in BONE_METRICS.items():
        absent = [joint for joint in joints if joint not in true]
        value, note = np.nan, f"the truth has no direction of {', '.join(absent)}"
        if not absent:
            errors = [
                direction_errors_deg(predicted[joint], true[joint], BONE_AT_REST[joint])
                for joint in joints
            ]
            value = float(np.nanmean(errors))
        rows.append(scored_row(result, video, metric, value, note))
    return rows


def jitter_row(result: str, video: str, predicted: CameraJoints, fps: float) -> ScoreRow:
    """Jitter of all joints of the result."""
    value = trajectory.jitter_10m_s3(predicted.joints_m, predicted.frames, fps)
    return scored_row(result, video, JITTER, value, "no four frames in a row")


def stretch_row(result: str, video: str, shares: Float[np.ndarray, " T"]) -> ScoreRow:
    """Mean share of stretched edges."""
    return scored_row(result, video, STRETCHED, 100 * float(shares.mean()), "no frame")


def unscored_rows(result: str, video: str, notes: Mapping[str, str]) -> list[ScoreRow]:
    """Rows without values: metric -> reason."""
    return [ScoreRow(result, video, metric, None, note) for metric, note in notes.items()]
