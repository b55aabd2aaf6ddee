"""All scores of one action: every result, the rounds of the loop, hands and uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Hands,
    Keypoints,
    RefineSync,
    Sync,
    Uncertainty,
)
from imocap_core.body import Model
from imocap_core.evaluate.body_points import body_points
from imocap_core.evaluate.calibration import normalised_camera_rows, normalised_rows
from imocap_core.evaluate.hands import hand_rows
from imocap_core.evaluate.results import AFTER_LOOP, SINGLE_PASS, StageResult, round_results
from imocap_core.evaluate.scoreboard import against_truth, cycle_row, score
from imocap_core.evaluate.whole_body import (
    JointErrors,
    joint_position_errors_mm,
    joint_rotation_errors,
    whole_body_rows,
)
from imocap_core.io.truth import Truth
from imocap_core.metrics.scoring import ScoreRow, over_videos
from imocap_core.problem.relative_motion import relative_motions


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
    results: Sequence[StageResult],
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    sync: Sync,
    refined: RefineSync,
    claimed: Uncertainty,
    hands: Hands,
    truth: Truth | None,
    model: Model,
) -> ActionScores:
    """Score the results against the truth, where there is one.

    Args:
        sync, refined: the first synchronisation, and the loop's.
    """
    rows = score_results(results, keypoints, camera_motion, truth, model)
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
