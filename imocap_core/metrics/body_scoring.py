"""Whole-body and world metrics of one video as rows of a table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.metrics import world
from imocap_core.metrics.joint_rotations import (
    BONE_AT_REST,
    direction_errors_deg,
    joint_rotation_errors_deg,
    mpjae_deg,
    rotation_errors_deg,
)
from imocap_core.metrics.joints import hip_midpoint, missing_joints, select_joints
from imocap_core.metrics.scoring import (
    CameraJoints,
    ScoreRow,
    missing_note,
    on_common_frames,
    scored_row,
)
from imocap_core.metrics.whole_body import aligned_joint_errors_mm

JOINT_GROUPS = {
    "spine_mm": ("spine1", "spine2", "spine3"),
    "collars_neck_mm": ("left_collar", "right_collar", "neck"),
}
WORLD_METRICS = ("w_mpjpe_mm", "wa_mpjpe_mm", "rte_pct")
ROTATION_METRICS = ("mpjae_deg", "spine_rotation_error_deg")
SEGMENT_METRICS = {
    "pelvis_rotation_error_deg": "pelvis",
    "chest_rotation_error_deg": "spine3",
    "head_rotation_error_deg": "head",
}
BONE_METRICS = {
    "neck_direction_error_deg": ("neck",),
    "collars_direction_error_deg": ("left_collar", "right_collar"),
}
SURFACE_METRICS = ("pve_mm", "pve_without_hands_mm", "pa_pve_mm", "foot_sliding_mm")
STRETCH_METRICS = (
    "stretched_edges_pct",
    "stretched_edges_worst_pct",
    "torso_volume_change_pct",
    "torso_volume_change_worst_pct",
)
JITTER = "jitter_10m_s3"
BODY_METRICS = (
    *JOINT_GROUPS,
    *ROTATION_METRICS,
    *SEGMENT_METRICS,
    *BONE_METRICS,
    *SURFACE_METRICS,
    *WORLD_METRICS,
    JITTER,
    *STRETCH_METRICS,
)
_SPINE = [SMPL_JOINTS.index(name) for name in JOINT_GROUPS["spine_mm"]]


def aligned_errors_mm(predicted: CameraJoints, true: CameraJoints) -> dict[str, float]:
    """SMPL joint -> mean error after alignment on the twelve joints; joints that both have.

    Empty when one of the twelve is missing.
    """
    predicted, true = on_common_frames(predicted, true)
    if missing_note(predicted, true, EVAL_12):
        return {}
    both = [name for name in SMPL_JOINTS if name in predicted.names and name in true.names]
    errors = aligned_joint_errors_mm(
        select_joints(predicted.joints_m, predicted.names, both),
        select_joints(true.joints_m, true.names, both),
        anchors=[both.index(name) for name in EVAL_12],
    )
    return dict(zip(both, errors.tolist(), strict=True))


def joint_group_rows(
    result: str, video: str, predicted: CameraJoints, true: CameraJoints
) -> list[ScoreRow]:
    """Mean aligned errors of the spine, and of the collars with the neck."""
    errors = aligned_errors_mm(predicted, true)
    rows = []
    for metric, group in JOINT_GROUPS.items():
        note = missing_note(predicted, true, (*EVAL_12, *group))
        value = np.nan if note else float(np.mean([errors[name] for name in group]))
        rows.append(scored_row(result, video, metric, value, note or "no frame has both"))
    return rows


def world_rows(
    result: str, video: str, predicted: CameraJoints, true: CameraJoints
) -> list[ScoreRow]:
    """W-MPJPE and WA-MPJPE of the 24 joints (of twelve where the truth lacks others), and RTE."""
    predicted, true = on_common_frames(predicted, true)
    note = missing_note(predicted, true, EVAL_12)
    if note:
        return [ScoreRow(result, video, metric, None, note) for metric in WORLD_METRICS]
    joints = EVAL_12 if missing_joints(true.names, SMPL_JOINTS) else SMPL_JOINTS
    pair = [select_joints(m.joints_m, m.names, joints) for m in (predicted, true)]
    roots = [hip_midpoint(m.joints_m, m.names) for m in (predicted, true)]
    complete = np.isfinite(pair[0] + pair[1]).all(axis=(1, 2))
    pair, roots = [x[complete] for x in pair], [x[complete] for x in roots]
    values = (
        (world.w_mpjpe_mm(*pair), "no frame has both"),
        (world.wa_mpjpe_mm(*pair), "no frame has both"),
        (world.rte_pct(*roots), "the true root does not move"),
    )
    return [
        scored_row(result, video, metric, *value)
        for metric, value in zip(WORLD_METRICS, values, strict=True)
    ]


def rotation_rows(
    result: str,
    video: str,
    predicted: Float[np.ndarray, "T 24 3 3"],
    true: Float[np.ndarray, "T 24 3 3"],
) -> list[ScoreRow]:
    """Errors of local joint rotations: all 24, and the mean of the three of the spine."""
    spine = joint_rotation_errors_deg(predicted[:, _SPINE], true[:, _SPINE]).mean()
    values = (mpjae_deg(predicted, true), float(spine))
    return [
        scored_row(result, video, metric, value, "no frame has both")
        for metric, value in zip(ROTATION_METRICS, values, strict=True)
    ]


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
    value = world.jitter_10m_s3(predicted.joints_m, predicted.frames, fps)
    return scored_row(result, video, JITTER, value, "no four frames in a row")


def stretch_rows(
    result: str,
    video: str,
    stretched_shares: Float[np.ndarray, " T"],
    torso_volumes: Float[np.ndarray, " T"],
) -> list[ScoreRow]:
    """Mean and worst frame of stretched edges, and of the change of the torso's volume.

    Args:
        torso_volumes: relative to the volume at rest.
    """
    change = np.abs(torso_volumes - 1)
    values = (
        stretched_shares.mean(),
        stretched_shares.max(initial=0.0),
        change.mean(),
        change.max(initial=0.0),
    )
    return [
        scored_row(result, video, metric, 100 * float(value), "no frame")
        for metric, value in zip(STRETCH_METRICS, values, strict=True)
    ]


def unscored_rows(result: str, video: str, notes: Mapping[str, str]) -> list[ScoreRow]:
    """Rows without values: metric -> reason."""
    return [ScoreRow(result, video, metric, None, note) for metric, note in notes.items()]
