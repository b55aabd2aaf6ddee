"""All scores of one action: every result, the rounds of the loop, hands and uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.adapters.relative_motion import relative_motions
from imocap_core.artifacts.schemas import (
    CameraMotion,
    Hands,
    Keypoints,
    RefineSync,
    Sync,
    Uncertainty,
    VideoMotion,
)
from imocap_core.body import Model
from imocap_core.conventions import EVAL_12, EVAL_INDICES, SMPL_JOINTS
from imocap_core.evaluate.scoreboard import (
    AFTER_LOOP,
    SINGLE_PASS,
    StageResult,
    against_truth,
    body_points,
    cycle_row,
    round_results,
    score,
    true_joints,
    video_truth,
)
from imocap_core.evaluate.whole_body_scores import (
    JointErrors,
    joint_position_errors_mm,
    joint_rotation_errors,
    whole_body_rows,
)
from imocap_core.io.truth import Truth
from imocap_core.metrics.calibration import (
    coverage_error,
    covered_share,
    normalised_error,
    probability_content,
)
from imocap_core.metrics.position import (
    HIPS,
    hand_mpjpe_mm,
    hand_mpjpe_scaled_mm,
    hand_pa_mpjpe_mm,
    missing_joints,
    root_relative,
)
from imocap_core.metrics.scoring import ScoreRow, over_videos, scored_row

ERRORS = ("hand_mpjpe_mm", "hand_mpjpe_scaled_mm", "hand_pa_mpjpe_mm", "hand_mpjpe_seen_mm")
VISIBLE_SHARE = "hand_seen_share"
METRICS = (*ERRORS, VISIBLE_SHARE)


def hand_rows(name: str, hands: Hands, truth: Truth | None) -> list[ScoreRow]:
    """Errors of every video's hands and the share with keypoints; no row without hands."""
    rows = []
    for video in hands.videos:
        rows.append(ScoreRow(name, video.id, VISIBLE_SHARE, float(video.visible.mean())))
        of_video = video_truth(truth, video.id)
        if of_video is None or of_video.hands is None or of_video.R is None:
            rows += [ScoreRow(name, video.id, m, None, "no truth of hands") for m in ERRORS]
            continue
        true = of_video.hands @ of_video.R.T  # errors are relative to the wrist: no translation
        visible = np.where(video.visible[..., None, None] > 0, video.points_m, np.nan)
        values = (
            hand_mpjpe_mm(video.points_m, true),
            hand_mpjpe_scaled_mm(video.points_m, true),
            hand_pa_mpjpe_mm(video.points_m, true),
            hand_mpjpe_mm(visible, true),
        )
        rows += [
            scored_row(name, video.id, metric, value, "no frame has both")
            for metric, value in zip(ERRORS, values, strict=True)
        ]
    return rows


NORMALISED = ("normalised_error", "normalised_depth_error", "normalised_across_error")
COVERED = {"covered_50_share": 0.5, "covered_80_share": 0.8, "covered_90_share": 0.9}
CALIBRATION_METRICS = (*NORMALISED, *COVERED, "coverage_error")
CAMERA_ERROR, NORMALISED_CAMERA_ERROR = "camera_rotation_error_deg", "normalised_camera_error"


def normalised_rows(
    name: str, claimed: Uncertainty, motions: Sequence[VideoMotion], truth: Truth | None
) -> list[ScoreRow]:
    """Each video's normalised errors and coverage over 12 joints, or the reason why they cannot be
    scored."""
    rows = []
    for video, motion in zip(claimed.videos, motions, strict=True):
        errors = joint_errors_mm(motion, truth)
        if errors is None:
            rows += [
                ScoreRow(name, video.id, metric, None, "no truth") for metric in CALIBRATION_METRICS
            ]
            continue
        sight = motion.joints[:, 0] / np.linalg.norm(motion.joints[:, 0], axis=-1, keepdims=True)
        along = np.einsum("tjx,tx->tj", errors, sight)
        across = np.sqrt(np.maximum((errors**2).sum(-1) - along**2, 0.0))
        pairs = (
            (np.linalg.norm(errors, axis=-1), video.sigma_mm),
            (along, video.depth_mm),
            (across, video.across_mm),
        )
        values = {
            metric: normalised_error(error, sigma[:, EVAL_INDICES])
            for metric, (error, sigma) in zip(NORMALISED, pairs, strict=True)
        }
        content = probability_content(errors, video.covariance_mm2[:, EVAL_INDICES])
        values |= {metric: covered_share(content, level) for metric, level in COVERED.items()}
        rows += [
            scored_row(name, video.id, metric, value, "no frame")
            for metric, value in (values | {"coverage_error": coverage_error(content)}).items()
        ]
    return rows


def normalised_camera_rows(rows: Sequence[ScoreRow], claimed: Uncertainty) -> list[ScoreRow]:
    """Of each scored rotation of a camera its error over the claimed standard deviation."""
    sd_deg = {video.id: video.camera_rotation_deg for video in claimed.videos}
    normalised = []
    for row in (row for row in rows if row.metric == CAMERA_ERROR):
        value, note = None, row.note
        if row.value is not None:
            claims = sd_deg[row.video] > 0  # False where NaN
            value = row.value / sd_deg[row.video] if claims else None
            note = "" if claims else "no standard deviation is claimed"
        normalised.append(ScoreRow(row.result, row.video, NORMALISED_CAMERA_ERROR, value, note))
    return normalised


def joint_errors_mm(
    motion: VideoMotion, truth: Truth | None, joints: Sequence[str] = EVAL_12
) -> Float[np.ndarray, "T J 3"] | None:
    """Errors of joints relative to the hips' middle, camera axes; None where the truth has not all
    of them."""
    true = true_joints(video_truth(truth, motion.id), motion.frames)
    if true is None or missing_joints(true.names, (*joints, *HIPS)):
        return None
    predicted = root_relative(motion.joints, SMPL_JOINTS, joints)
    return np.asarray(1000 * (predicted - root_relative(true.joints_m, true.names, joints)))


@dataclass(frozen=True)
class ActionScores:
    """rows: every metric of every video. summary: over the videos. rounds: per round of the loop,
    metric -> mean over the videos. joint_errors_mm, joint_errors_deg: result -> errors of the
    positions (aligned on the twelve joints) and rotations of each joint. Without truth empty
    dictionaries."""

    rows: list[ScoreRow]
    summary: list[ScoreRow]
    rounds: list[dict[str, float]]
    joint_errors_mm: dict[str, JointErrors]
    joint_errors_deg: dict[str, JointErrors]


def score_action(
    of_results: Sequence[ScoreRow],
    results: Sequence[StageResult],
    keypoints: Keypoints,
    sync: Sync,
    refined: RefineSync,
    claimed: Uncertainty,
    hands: Hands,
    truth: Truth | None,
) -> ActionScores:
    """Score the results against the truth, where there is one.

    Args:
        of_results: of `score_results`.
        sync, refined: the first synchronisation, and the loop's.
    """
    rows = [*of_results]
    rows += [cycle_row(SINGLE_PASS, sync), cycle_row(AFTER_LOOP, refined.sync)]
    after = [row for row in rows if row.result == AFTER_LOOP]
    rows += normalised_camera_rows(after, claimed)
    rows += normalised_rows(AFTER_LOOP, claimed, refined.motion.videos, truth)
    rows += hand_rows(AFTER_LOOP, hands, truth)
    rounds = [against_truth(result, keypoints, truth) for result in round_results(refined)]
    return ActionScores(
        rows,
        over_videos(rows),
        rounds,
        {result.name: joint_position_errors_mm(result, truth) for result in results},
        {result.name: joint_rotation_errors(result, truth) for result in results},
    )


def score_results(
    results: Sequence[StageResult],
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    truth: Truth | None,
    model: Model,
) -> list[ScoreRow]:
    """Every metric of some results, one after another, with their bodies posed by `model`."""
    whole = whole_body_rows(results, keypoints, truth, model)
    pairs = zip(results, whole, strict=True)
    return [
        row
        for result, rows in pairs
        for row in (*_joint_rows(result, keypoints, camera_motion, truth, model), *rows)
    ]


def _joint_rows(
    result: StageResult,
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    truth: Truth | None,
    model: Model,
) -> list[ScoreRow]:
    """Metrics of joints, keypoints, cameras and synchronisation."""
    K = {c.id: c.K for c in result.cameras or camera_motion.videos}
    filmed = relative_motions(result.motions, result.paths or {})
    points = {
        video.id: body_points(model, motion, video.layout, K[video.id])
        for video, motion in zip(keypoints.videos, filmed, strict=True)
    }
    xy_first_px = {c.id: c.xy_first_px for c in camera_motion.videos}
    return score(result, keypoints, truth, points, xy_first_px)
