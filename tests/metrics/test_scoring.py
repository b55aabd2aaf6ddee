"""Rows of a table: named, complete, and honest about what could not be scored; claims are compared
with errors; synchronisation errors by hand."""

import math
from itertools import permutations

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from benchmarks.sync_reliability import expected_calibration_error
from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.metrics import sync
from imocap_core.metrics.calibration import (
    along_and_across,
    coverage_error,
    covered_share,
    normalised_error,
    normalised_errors,
    probability_content,
    total_sigma,
)
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


def test_honest_claims_give_one_and_doubled_ones_a_half() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T
    errors = rng.multivariate_normal(np.zeros(3), covariance, (4000, 2))
    sigma = np.broadcast_to(total_sigma(covariance), (4000, 2))
    length = np.linalg.norm(errors, axis=-1)
    assert normalised_error(length, sigma) == pytest.approx(1, abs=0.03)
    assert normalised_errors(length, 2 * sigma) == pytest.approx([0.5, 0.5], abs=0.03)


def test_variance_is_split_between_along_and_across() -> None:
    along, across = along_and_across(np.diag([1.0, 4.0, 9.0]), np.array([0.0, 0.0, 1.0]))
    assert along == pytest.approx(3)
    assert across == pytest.approx(np.sqrt(5))
    tilted = np.array([0.6, 0.0, 0.8])
    along, across = along_and_across(np.diag([1.0, 4.0, 9.0]), tilted)
    assert along**2 + across**2 == pytest.approx(14)


def test_regions_of_honest_claims_hold_what_they_claim_and_small_ones_less() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T
    errors = rng.multivariate_normal(np.zeros(3), covariance, (5000, 2))
    claims = np.broadcast_to(covariance, (5000, 2, 3, 3))
    honest, small, large = (probability_content(errors, k * claims) for k in (1.0, 0.25, 4.0))
    for level in (0.5, 0.8, 0.9):
        assert covered_share(honest, level) == pytest.approx(level, abs=0.02)
        assert covered_share(small, level) < level - 0.1 < level < covered_share(large, level)
    assert coverage_error(honest) < 0.02
    assert min(coverage_error(small), coverage_error(large)) > 0.2
    turn = np.linalg.qr(root)[0]
    turned = probability_content(errors @ turn.T, turn @ claims @ turn.T)
    np.testing.assert_allclose(turned, honest, atol=1e-9)


def test_unknown_claims_cover_nothing() -> None:
    errors, claims = np.zeros((2, 3)), np.stack([np.eye(3), np.full((3, 3), np.nan)])
    content = probability_content(errors, claims)
    assert content[0] == 0
    assert np.isnan(content[1])
    assert covered_share(content, 0.5) == 1
    assert np.isnan(coverage_error(content[1:]))


def test_what_is_unknown_is_left_out() -> None:
    errors, sigmas = np.array([3.0, np.nan, 1.0]), np.array([1.0, 1.0, np.nan])
    assert normalised_error(errors, sigmas) == pytest.approx(3)
    assert np.isnan(normalised_error(np.array([np.nan]), np.array([1.0])))


@pytest.mark.usefixtures("unchecked_shapes")
def test_shapes_that_do_not_fit_are_named() -> None:
    with pytest.raises(ValueError, match=r"both be \(T, J\), got \(4, 2\) and \(4, 3\)"):
        normalised_errors(np.ones((4, 2)), np.ones((4, 3)))


def test_the_calibration_error_is_the_gap_between_claim_and_truth() -> None:
    confidence = np.array([0.9] * 10 + [0.5] * 10)
    honest = np.array([True] * 9 + [False] + [True] * 5 + [False] * 5)
    assert expected_calibration_error(confidence, honest) == pytest.approx(0.0)
    assert expected_calibration_error(confidence, np.zeros(20, bool)) == pytest.approx(0.7)
    assert expected_calibration_error(np.ones(4), np.array([True, True, True, False])) == 0.25


# The reference shows phases 0, 10, ..., 100 in its source frames 5, 6, ..., 15.
REFERENCE_FRAMES = np.arange(5, 16)
REFERENCE_PHASE = 10.0 * np.arange(11)


def _errors(matched: ArrayLike, phase: ArrayLike) -> sync.SyncErrors:
    return sync.sync_errors(
        np.asarray(matched), np.asarray(phase), REFERENCE_FRAMES, REFERENCE_PHASE, phase_end=200.0
    )


def test_true_position_interpolates_and_has_no_counterpart_outside() -> None:
    frames = sync.true_reference_frame(
        np.array([-1, 0, 25, 100, 101]), REFERENCE_FRAMES, REFERENCE_PHASE
    )
    np.testing.assert_array_equal(frames, [np.nan, 5, 7.5, 15, np.nan])


def test_errors_by_hand():
    # Phases 20 and 35 lie at reference frames 7 and 8.5; matched at 8 and 8: off by 1 and 0.5
    # frames, by 10 and 5 of 200 in phase.
    errors = _errors([8, 8], [20, 35])
    np.testing.assert_allclose(errors.frames, [1, 0.5])
    assert sync.sync_error_pct(errors) == pytest.approx(3.75)
    assert sync.sync_error_released_pct(errors) == pytest.approx(
        5.0
    )  # 20 alone is a reference phase
    assert sync.sync_error_frames(errors) == pytest.approx(0.75)
    assert sync.sync_median_error_frames(errors) == pytest.approx(0.75)
    assert sync.sync_error_ms(errors, reference_fps=25) == pytest.approx(30)


def test_the_true_map_has_no_error() -> None:
    phase = np.linspace(3, 97, 40)
    errors = _errors(sync.true_reference_frame(phase, REFERENCE_FRAMES, REFERENCE_PHASE), phase)
    assert sync.sync_error_pct(errors) == pytest.approx(0, abs=1e-12)
    assert sync.sync_error_frames(errors) == pytest.approx(0, abs=1e-12)
    assert sync.matched_share(errors) == 1
    assert np.isnan(
        sync.sync_error_released_pct(errors)
    )  # no frame of one falls on one of the other


def test_frames_without_counterpart_do_not_enter_the_mean() -> None:
    errors = _errors([5, 7, np.nan, 15, np.nan], [-30, 20, 30, 140, 150])
    assert sync.sync_error_frames(errors) == pytest.approx(0)
    assert sync.matched_share(errors) == pytest.approx(1 / 2)  # of phases 20 and 30
    assert sync.false_match_share(errors) == pytest.approx(2 / 3)  # of phases -30, 140 and 150


def test_percentage_does_not_see_the_unit_of_phase() -> None:
    matched, phase = np.array([8, 8]), np.array([20, 35])
    a = sync.sync_errors(matched, phase, REFERENCE_FRAMES, REFERENCE_PHASE, 100)
    b = sync.sync_errors(matched, phase / 100, REFERENCE_FRAMES, REFERENCE_PHASE / 100, 1)
    assert sync.sync_error_pct(a) == pytest.approx(sync.sync_error_pct(b))


def test_nothing_matched_is_nan_not_zero() -> None:
    errors = _errors([np.nan, np.nan], [20, 35])
    assert np.isnan(sync.sync_error_pct(errors))
    assert np.isnan(sync.sync_median_error_frames(errors))
    assert sync.matched_share(errors) == 0
    assert np.isnan(sync.false_match_share(errors))


def test_offset_by_hand() -> None:
    matched = np.array([3, 4, 5.5, np.nan])
    assert sync.offset_frames(matched, np.array([1, 2, 3, 4])) == pytest.approx(2)
    assert np.isnan(sync.offset_frames(np.array([np.nan]), np.array([1])))


@pytest.mark.parametrize("videos", [2, 3, 4])
def test_consistent_maps_come_back_to_where_they_started(videos: int) -> None:
    pairs = permutations(range(videos), 2)
    assert sync.cycle_residual_frames(dict.fromkeys(pairs, np.arange(6))) == 0
    assert np.isnan(sync.cycle_residual_frames({}))


def test_cycle_residual_by_hand():
    # There: frame t to t + 1 (the last stays); back: t to t. So all but one of the frames that
    # start in either video come back one too far, the other comes back at once.
    nearest = {(0, 1): np.array([1, 2, 3, 4, 5, 5]), (1, 0): np.arange(6)}
    assert sync.cycle_residual_frames(nearest) == 1


@pytest.mark.usefixtures("unchecked_shapes")
def test_misuse_is_named() -> None:
    one, two = np.array([1]), np.array([0, 1])
    with pytest.raises(ValueError, match="phase that rises"):
        sync.sync_errors(one, one, np.array([0, 1, 2]), np.array([0, 2, 1]), 1)
    with pytest.raises(ValueError, match="phase_end must be positive"):
        sync.sync_errors(one, one, two, two, 0)
    with pytest.raises(ValueError, match=r"both be \(T,\)"):
        sync.sync_errors(two, one, two, two, 1)


def test_a_repeated_reference_frame_is_no_fault():
    # The reference shows phase 10 twice: a frame of phase 10 may be matched to either.
    for matched in (1, 2):
        errors = sync.sync_errors(
            np.array([matched]), np.array([10]), np.arange(4), np.array([0, 10, 10, 20]), 20
        )
        assert sync.sync_error_pct(errors) == 0
