"""All metrics of one video at once, as rows of a table; what cannot be scored says why."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imocap_core.conventions import EVAL_12, EVAL_14, EVAL_17
from imocap_core.metrics import camera, position, sync, trajectory
from imocap_core.metrics.joints import HIPS, hip_midpoint, missing_joints, root_relative

ALL_VIDEOS = "all videos"
JOINT_SETS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("", EVAL_12),
    ("_14", EVAL_14),
    ("_17", EVAL_17),
)
POSITION_METRICS = {
    "mpjpe_mm": position.mpjpe_mm,
    "mpjpe_scaled_mm": position.mpjpe_scaled_mm,
    "pa_mpjpe_mm": position.pa_mpjpe_mm,
}
MOTION_METRICS = (
    "acceleration_error_m_s2",
    "root_path_error_mm",
    "root_path_aligned_error_mm",
    "foot_sliding_mm_s",
    "planted_foot_speed_mm_s",
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
class Row:
    """One number, or the reason why there is none (value None)."""

    result: str  # which stage's answer: "monocular", "single pass", "after loop"
    video: str
    metric: str  # its name ends in its unit; docs/metrics.md defines it
    value: float | None
    note: str = ""


@dataclass(frozen=True)
class Motion:
    """Joints of one video in the axes of its own camera; prediction or truth."""

    joints_m: NDArray[np.float64]  # (T, J, 3)
    names: tuple[str, ...]
    frames: NDArray[np.int64]  # (T,) source frame numbers


def pose_rows(result: str, video: str, predicted: Motion, true: Motion, fps: float) -> list[Row]:
    """Position, acceleration, root path and foot sliding of one video."""
    predicted, true = _on_common_frames(predicted, true)
    rows: list[Row] = []
    for suffix, wanted in JOINT_SETS:
        lack = _lack(predicted, true, (*wanted, *HIPS))
        for name, metric in POSITION_METRICS.items():
            label = name.replace("mpjpe", f"mpjpe{suffix}")
            if lack:
                rows.append(Row(result, video, label, None, lack))
                continue
            pair = (root_relative(m.joints_m, m.names, wanted) for m in (predicted, true))
            rows.append(_row(result, video, label, metric(*pair), "no frame has both"))
    return rows + _motion_rows(result, video, predicted, true, fps)


def _motion_rows(result: str, video: str, predicted: Motion, true: Motion, fps: float) -> list[Row]:
    """What depends on how joints move from frame to frame."""
    lack = _lack(predicted, true, EVAL_12)
    if lack:
        return [Row(result, video, name, None, lack) for name in MOTION_METRICS]
    roots = [hip_midpoint(m.joints_m, m.names) for m in (predicted, true)]
    relative = [root_relative(m.joints_m, m.names, EVAL_12) for m in (predicted, true)]
    ankles = [EVAL_12.index("left_ankle"), EVAL_12.index("right_ankle")]
    feet, true_feet = (r[:, ankles] + o[:, None] for r, o in zip(relative, roots, strict=True))
    standing = trajectory.standing_feet(true_feet, fps)
    values = (
        position.acceleration_error_m_s2(relative[0], relative[1], true.frames, fps),
        trajectory.root_path_error_mm(*roots),
        trajectory.root_path_aligned_error_mm(*roots),
        trajectory.foot_sliding_mm_s(feet, standing, fps, moving=true_feet),
        trajectory.planted_foot_speed_mm_s(feet, standing, fps),
    )
    stood = "no foot stands"
    why = ("no three frames in a row", "no frame has both", "too few frames", stood, stood)
    return [_row(result, video, *item) for item in zip(MOTION_METRICS, values, why, strict=True)]


def sync_rows(
    result: str,
    video: str,
    matched_reference_frame: ArrayLike,
    frames: ArrayLike,
    phase: ArrayLike,
    reference_frames: ArrayLike,
    reference_phase: ArrayLike,
    phase_end: float,
    reference_fps: float,
) -> list[Row]:
    """Synchronisation errors of one video that is not the reference; see `sync.sync_errors`."""
    errors = sync.sync_errors(
        matched_reference_frame, phase, reference_frames, reference_phase, phase_end
    )
    true_at = sync.true_reference_frame(phase, reference_frames, reference_phase)
    constant = sync.is_offset(true_at, frames)
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
        (abs(offset - sync.offset_frames(true_at, frames)), no_offset),
        (sync.matched_share(errors), "no frame has a counterpart"),
        (sync.false_match_share(errors), "every frame has a counterpart"),
    )
    return [
        _row(result, video, name, *pair) for name, pair in zip(SYNC_METRICS, pairs, strict=True)
    ]


def camera_row(
    result: str,
    video: str,
    R_cam_from_world: ArrayLike,
    R_ref_from_world: ArrayLike,
    R_cam_from_true_world: ArrayLike,
    R_ref_from_true_world: ArrayLike,
) -> Row:
    """Rotation error of one camera that is not the reference's."""
    error = camera.camera_rotation_error_deg(
        R_cam_from_world, R_ref_from_world, R_cam_from_true_world, R_ref_from_true_world
    )
    return _row(result, video, "camera_rotation_error_deg", float(error), "not recovered")


def reprojection_rows(
    result: str,
    video: str,
    points_cam_m: ArrayLike,
    K: ArrayLike,
    xy_px: ArrayLike,
    confidence: ArrayLike,
    person_height_px: float,
) -> list[Row]:
    """Distance of the body's keypoints to the detections, in pixels and of the person's height."""
    errors = camera.reprojection_errors_px(points_cam_m, K, xy_px, confidence)
    mean = camera.reprojection_error_px(errors, confidence)
    return [
        _row(result, video, "reprojection_px", mean, "nothing was detected"),
        _row(
            result, video, "reprojection_pct", 100 * mean / person_height_px, "nothing was detected"
        ),
    ]


def over_videos(rows: Sequence[Row]) -> list[Row]:
    """One summary row per result and metric, unweighted over the videos that could be scored."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.result, row.metric), []).append(row)
    return [_summary(group) for group in groups.values()]


def _summary(group: Sequence[Row]) -> Row:
    values = [row.value for row in group if row.value is not None]
    head = replace(group[0], video=ALL_VIDEOS)
    if not values:
        return replace(head, value=None, note=_joined(row.note for row in group))
    over = np.median if head.metric in MEDIAN_OVER_VIDEOS else np.mean
    partly = "" if len(values) == len(group) else f"{len(values)} of {len(group)} videos scored"
    return replace(head, value=float(over(values)), note=partly)


def _joined(notes: Iterable[str]) -> str:
    return "; ".join(dict.fromkeys(note for note in notes if note))


def _row(result: str, video: str, metric: str, value: float, if_nan: str) -> Row:
    if math.isfinite(value):
        return Row(result, video, metric, float(value))
    return Row(result, video, metric, None, if_nan)


def _lack(predicted: Motion, true: Motion, wanted: Sequence[str]) -> str:
    for who, motion in (("the truth", true), ("the result", predicted)):
        absent = missing_joints(motion.names, wanted)
        if absent:
            return f"{who} has no {', '.join(absent)}"
    return ""


def _on_common_frames(a: Motion, b: Motion) -> tuple[Motion, Motion]:
    common, in_a, in_b = np.intersect1d(a.frames, b.frames, return_indices=True)
    return (
        Motion(a.joints_m[in_a], a.names, common),
        Motion(b.joints_m[in_b], b.names, common),
    )
