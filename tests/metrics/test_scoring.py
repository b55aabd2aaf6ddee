"""Rows of a table: named, complete, and honest about what could not be scored."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.metrics.scoring import (
    ALL_VIDEOS,
    POSE_METRICS,
    SYNC_METRICS,
    CameraJoints,
    ScoreRow,
    aligned_errors_mm,
    camera_row,
    jitter_row,
    over_videos,
    pose_rows,
    reprojection_rows,
    segment_rows,
    stretch_row,
    sync_rows,
    world_rows,
)


@pytest.fixture
def joints() -> np.ndarray:
    return np.random.default_rng(5).normal(scale=0.3, size=(8, 24, 3)) + np.array([0, 0, 4])


def _by_metric(rows: list[ScoreRow]) -> dict[str, ScoreRow]:
    assert len({row.metric for row in rows}) == len(rows)
    return {row.metric: row for row in rows}


def _motion(
    joints: np.ndarray, names: tuple[str, ...] = SMPL_JOINTS, start: int = 0
) -> CameraJoints:
    return CameraJoints(joints, names, np.arange(start, start + len(joints)))


def test_a_perfect_result_has_no_error(joints: np.ndarray) -> None:
    rows = _by_metric(pose_rows("final", "v1", _motion(joints), _motion(joints), fps=30))
    assert rows["mpjpe_mm"].value == pytest.approx(0, abs=1e-9)
    assert tuple(rows) == POSE_METRICS
    assert rows["pa_mpjpe_14_mm"].value == pytest.approx(0, abs=1e-9)
    assert rows["root_path_error_mm"].value == pytest.approx(0, abs=1e-9)
    assert rows["acceleration_error_m_s2"].value == pytest.approx(0, abs=1e-9)


def test_an_unscored_metric_names_the_joint_that_lacks(joints: np.ndarray) -> None:
    rows = _by_metric(pose_rows("final", "v1", _motion(joints), _motion(joints), fps=30))
    assert rows["mpjpe_17_mm"].value is None
    assert "nose" in rows["mpjpe_17_mm"].note
    without_hip = _motion(joints[:, 2:], SMPL_JOINTS[2:])
    rows = _by_metric(pose_rows("final", "v1", _motion(joints), without_hip, fps=30))
    assert all(row.value is None and "left_hip" in row.note for row in rows.values())


def test_frames_are_paired_by_number_not_by_position(joints: np.ndarray) -> None:
    early, late = _motion(joints[:6]), _motion(joints[2:], start=2)
    rows = _by_metric(pose_rows("final", "v1", early, late, fps=30))
    assert rows["mpjpe_mm"].value == pytest.approx(0, abs=1e-9)
    apart = pose_rows("final", "v1", _motion(joints), _motion(joints, start=99), fps=30)
    assert all(row.value is None for row in apart)


def test_twelve_joints_are_the_default_set(joints: np.ndarray) -> None:
    off = joints.copy()
    off[:, SMPL_JOINTS.index("head")] += 0.14  # not among the 12
    rows = _by_metric(pose_rows("final", "v1", _motion(off), _motion(joints), fps=30))
    assert rows["mpjpe_mm"].value == pytest.approx(0, abs=1e-9)
    assert rows["mpjpe_14_mm"].value == pytest.approx(1000 * 0.14 * math.sqrt(3) / 14)
    assert "head" not in EVAL_12


def test_seventeen_joints_by_hand(joints: np.ndarray) -> None:
    names = (*SMPL_JOINTS, "nose")
    true = np.concatenate([joints, joints[:, :1] + [0, 0.6, 0]], axis=1)
    off = true.copy()
    off[:, -1] += [0.034, 0, 0]
    rows = _by_metric(pose_rows("final", "v1", _motion(off, names), _motion(true, names), fps=30))
    assert rows["mpjpe_17_mm"].value == pytest.approx(34.0 / 17)
    assert rows["mpjpe_14_mm"].value == pytest.approx(0, abs=1e-9)


def test_sync_rows_of_equal_clocks():
    # Equal frame numbers correspond; the map is 2 frames late throughout.
    frames = np.arange(10, 20)
    rows = _by_metric(
        sync_rows("final", "v2", frames + 2.0, frames, frames, np.arange(0, 40), np.arange(0, 40),
                  phase_end=50, reference_fps=25)
    )  # fmt: skip
    assert tuple(rows) == SYNC_METRICS
    assert rows["sync_error_frames"].value == pytest.approx(2)
    assert rows["sync_error_ms"].value == pytest.approx(80)
    assert rows["sync_error_pct"].value == pytest.approx(4)
    assert rows["sync_error_released_pct"].value == pytest.approx(4)
    assert rows["offset_frames"].value == pytest.approx(2)
    assert rows["offset_error_frames"].value == pytest.approx(2)
    assert rows["false_match_share"].value is None


def test_an_offset_is_shown_only_where_the_truth_is_one() -> None:
    frames, reference = np.arange(10), np.arange(40)
    rows = _by_metric(
        sync_rows("final", "v2", frames + 3.0, frames, 2.0 * frames, reference, reference, 50, 25)
    )
    assert rows["offset_error_frames"].value is None
    assert "more than an offset" in rows["offset_error_frames"].note
    assert rows["sync_error_frames"].value == pytest.approx(np.abs(3 - np.arange(10)).mean())


def test_camera_and_reprojection_rows() -> None:
    eye = np.eye(3)
    assert camera_row("final", "v2", eye, eye, eye, eye).value == pytest.approx(0, abs=1e-6)
    K = np.array([[100.0, 0, 0], [0, 100, 0], [0, 0, 1]])
    points, detected = np.array([[[0.0, 0, 1]]]), np.array([[[3.0, 4]]])
    rows = _by_metric(reprojection_rows("final", "v1", points, K, detected, np.ones((1, 1)), 50))
    assert rows["reprojection_px"].value == pytest.approx(5)
    assert rows["reprojection_pct"].value == pytest.approx(10)
    unseen = reprojection_rows("final", "v1", points, K, detected, np.zeros((1, 1)), 50)
    assert [row.value for row in unseen] == [None, None]


def test_summary_is_unweighted_and_counts_the_scored_videos() -> None:
    rows = [
        ScoreRow("a", "v1", "mpjpe_mm", 10.0),
        ScoreRow("a", "v2", "mpjpe_mm", 40.0),
        ScoreRow("a", "v3", "mpjpe_mm", None, "no truth"),
        ScoreRow("b", "v1", "mpjpe_mm", None, "no truth"),
        ScoreRow("a", "v1", "offset_error_frames", 1.0),
        ScoreRow("a", "v2", "offset_error_frames", 2.0),
        ScoreRow("a", "v3", "offset_error_frames", 30.0),
    ]
    mean, none, median = over_videos(rows)
    assert mean == ScoreRow("a", ALL_VIDEOS, "mpjpe_mm", 25.0, "2 of 3 videos scored")
    assert none == ScoreRow("b", ALL_VIDEOS, "mpjpe_mm", None, "no truth")
    assert median.value == 2.0


def _values(rows: list[ScoreRow]) -> dict[str, float | None]:
    return {row.metric: row.value for row in rows}


def test_joints_besides_the_twelve_have_their_own_errors(joints: np.ndarray) -> None:
    off = joints.copy()
    off[:, SMPL_JOINTS.index("spine2")] += [0.09, 0, 0]
    errors = aligned_errors_mm(_motion(off), _motion(joints))
    assert list(errors) == list(SMPL_JOINTS)
    assert errors["spine2"] == pytest.approx(90.0)
    assert max(errors[name] for name in EVAL_12) == pytest.approx(0, abs=1e-9)


def test_a_truth_of_twelve_joints_scores_the_world(joints: np.ndarray) -> None:
    twelve = _motion(joints[:, [SMPL_JOINTS.index(name) for name in EVAL_12]], EVAL_12)
    world = _values(world_rows("final", "v1", _motion(joints), twelve))
    assert world["w_mpjpe_mm"] == pytest.approx(0, abs=1e-9)
    assert world["rte_pct"] == pytest.approx(0, abs=1e-9)


def test_frames_with_missing_joints_are_left_out_of_the_world(joints: np.ndarray) -> None:
    holed = joints.copy()
    holed[3, 5] = np.nan
    world = _values(world_rows("final", "v1", _motion(joints + 1), _motion(holed)))
    assert world["wa_mpjpe_mm"] == pytest.approx(0, abs=1e-9)


def test_segment_rows_are_angles_and_name_what_is_missing() -> None:
    upright, half_turn = (
        np.tile(np.eye(3), (4, 1, 1)),
        np.tile(np.diag([-1.0, 1.0, -1.0]), (4, 1, 1)),
    )
    predicted = {"pelvis": upright, "spine3": half_turn, "head": upright}
    rows = segment_rows("final", "v1", predicted, {"pelvis": upright, "spine3": upright})
    values = {row.metric: row.value for row in rows}
    assert values["pelvis_rotation_error_deg"] == pytest.approx(0.0)
    assert values["chest_rotation_error_deg"] == pytest.approx(180.0)
    assert values["head_rotation_error_deg"] is None
    assert "head" in {row.metric: row.note for row in rows}["head_rotation_error_deg"]


def test_directions_of_neck_and_collars_ignore_turns_about_the_bone() -> None:
    upright = np.tile(np.eye(3), (4, 1, 1))
    about_x = np.tile(Rotation.from_euler("x", 40, degrees=True).as_matrix(), (4, 1, 1))
    predicted = {"neck": about_x, "left_collar": about_x, "right_collar": about_x}
    true = dict.fromkeys(predicted, upright)
    values = _values(segment_rows("final", "v1", predicted, true))
    assert values["neck_direction_error_deg"] == pytest.approx(40.0)
    assert values["collars_direction_error_deg"] == pytest.approx(0.0, abs=1e-9)
    del true["right_collar"]
    rows = segment_rows("final", "v1", predicted, true)
    assert _values(rows)["collars_direction_error_deg"] is None
    assert "right_collar" in rows[-1].note


def test_stretched_edges_are_the_mean_in_per_cent() -> None:
    row = stretch_row("final", "v1", np.array([0.01, 0.03]))
    assert (row.metric, row.value) == ("stretched_edges_pct", pytest.approx(2.0))


def test_jitter_of_too_short_a_motion_is_not_scored(joints: np.ndarray) -> None:
    assert jitter_row("final", "v1", _motion(joints), 30.0).value is not None
    short = jitter_row("final", "v1", _motion(joints[:3]), 30.0)
    assert (short.value, short.note) == (None, "no four frames in a row")
