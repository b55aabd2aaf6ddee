"""All tables of the stage evaluate, in the order of the report."""

from __future__ import annotations

from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    Redetect,
    RefineSync,
    Table,
    Uncertainty,
)
from imocap_core.evaluate.action_scores import ActionScores
from imocap_core.io.truth import Truth
from imocap_core.metrics.scoring import ALL_VIDEOS
from imocap_core.report.event_table import event_tables
from imocap_core.report.ground_table import ground_tables
from imocap_core.report.hand_tables import hand_tables
from imocap_core.report.joint_tables import joint_tables
from imocap_core.report.observability_text import observability_table
from imocap_core.report.second_look_table import second_look_tables
from imocap_core.report.tables import long_table, metric_tables, round_table, video_table
from imocap_core.report.trust_tables import trust_tables
from imocap_core.report.uncertainty_tables import leave_one_out_tables, uncertainty_tables


def evaluation_tables(
    scores: ActionScores,
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    refined: RefineSync,
    claimed: Uncertainty,
    again: Redetect,
    truth: Truth | None,
) -> list[Table]:
    """The tables that the report shows."""
    every = [*scores.rows, *scores.summary]
    return [
        *metric_tables(scores.rows, scores.summary),
        *joint_tables(scores),
        *hand_tables(every),
        *([round_table(refined, scores.rounds)] if len(refined.rounds) > 1 else []),
        *second_look_tables(again),
        video_table(keypoints, camera_motion, refined),
        *ground_tables(initial, camera_motion, refined),
        *event_tables(refined),
        *trust_tables(refined.sync),
        observability_table(claimed, refined.sync),
        *leave_one_out_tables(claimed),
        *uncertainty_tables(claimed, refined.motion.videos, truth, every),
    ]


def all_scores_table(scores: ActionScores) -> Table:
    """The long table of every metric, for programs only."""
    per_video = [row for row in scores.rows if row.video != ALL_VIDEOS]
    return long_table([*per_video, *scores.summary])
