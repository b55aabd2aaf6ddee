"""Which frames have a counterpart: stillness is no evidence against one, other content is; a frozen
picture is one moment."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.sync import Anchor, Hints
from imocap_core.sync.affinity import distance_matrix
from imocap_core.sync.comparable_poses import (
    mean_of_known,
    of_one_amplitude,
    of_one_mean,
    picture_heights,
    pose_change,
    spread_over,
    squared_differences,
    vertical_motion,
)
from imocap_core.sync.evidence import SyncEvidence
from imocap_core.sync.freeze_frames import distinct_frames, frozen_runs, hints_of_pictures
from imocap_core.sync.procrustes import procrustes_distances
from imocap_core.sync.synchronise import synchronise
from imocap_core.sync.warp.soft_maps import evidence_of_match
from tests.sync.test_synchronise import FPS, LONG, PARAMS, error_s, estimated, pose_at, run

QUICK = replace(PARAMS, max_rate=32.0, consensus_rounds=1)
OPTIONS = {"matched_square": 0.002, "level": 1.0, "observations": 0.5}


def standing_first(phase: np.ndarray, rng: np.random.Generator, error_m: float) -> np.ndarray:
    """An estimate of a performer who stands still while the phase is below 0; standing, it errs by
    a pose of its own, as long as that lasts."""
    pose = pose_at(np.maximum(phase, 0.0)) + 0.02 * rng.normal(size=(len(phase), 12, 3))
    share = np.clip(1.0 - phase / 0.5, 0.0, 1.0)[:, None, None]
    turn = Rotation.random(random_state=int(rng.integers(1000))).as_matrix()
    return np.asarray((pose + share * error_m * rng.normal(size=(12, 3))) @ turn)


@pytest.mark.parametrize("error_m", [*(pytest.param(e, marks=LONG) for e in (0.03, 0.08)), 0.12])
def test_a_performer_who_stands_still_is_matched_however_wrong_the_pose(error_m: float) -> None:
    rng = np.random.default_rng(1)
    phases = [np.arange(-3 - 0.3 * v, 3, (1 + 0.1 * v) / FPS) for v in range(3)]
    videos = [standing_first(p, rng, error_m) for p in phases]
    result = run(videos, QUICK, reference=0)
    for phase, frames in zip(phases[1:], result.reference_frame[1:], strict=True):
        assert np.isfinite(frames[phase < 0]).mean() > 0.9
        assert np.isfinite(frames[phase >= 0]).all()


@pytest.mark.long
def test_a_video_that_stands_before_the_others_begin_is_unmatched_there() -> None:
    rng = np.random.default_rng(2)
    phases = [np.arange(s, 4, 1 / FPS) for s in (0.0, -3.0, 0.1)]
    videos = [standing_first(p, rng, 0.03) for p in phases]
    result = run(videos, QUICK, reference=0)
    early = phases[1] < -0.3
    assert np.isnan(result.reference_frame[1][early]).mean() > 0.9
    assert result.confidence[1][early].mean() < 0.1
    assert np.isfinite(result.reference_frame[1][phases[1] > 0.2]).all()


def test_a_nearer_pose_is_more_evidence() -> None:
    nearest = np.linspace(0.0, 0.05, 50)
    ratio = evidence_of_match(nearest, np.full(50, 0.01), **OPTIONS)
    assert (np.diff(ratio) < 0).all()
    assert ratio[0] > 0 > ratio[-1]


def test_a_still_pose_says_nothing_against_a_match_and_a_moving_one_says_all() -> None:
    far = np.full(3, 0.1)
    still, slow, moving = evidence_of_match(far, np.array([0.0, 0.0005, 1.0]), **OPTIONS)
    assert still > 0 > slow > moving
    near = evidence_of_match(np.full(2, 0.001), np.array([0.0, 1.0]), **OPTIONS)
    assert near[0] == near[1] > 0


def test_at_an_infinite_level_every_frame_has_a_counterpart() -> None:
    ratio = evidence_of_match(np.full(3, 9.0), np.ones(3), **(OPTIONS | {"level": np.inf}))
    assert (ratio == np.inf).all()


def test_the_change_of_a_pose_ignores_where_the_body_is_and_turns() -> None:
    phase = np.arange(0, 4, 1 / FPS)
    still = np.repeat(pose_at(np.zeros(1)), len(phase), axis=0)
    weights = np.ones(still.shape[:2])
    turn = Rotation.from_rotvec(np.array([0.0, 0.0, 0.5])).as_matrix()
    moved = still @ turn + np.array([1.0, 2.0, 3.0])
    both = np.concatenate([still[:60], moved[60:]])
    assert pose_change(still, weights, FPS).max() < 1e-9
    away = np.abs(np.arange(len(phase)) - 60) > 16
    assert pose_change(both, weights, FPS)[away].max() < 1e-9
    moving = pose_at(phase)
    change = pose_change(moving, weights, FPS)
    assert change.min() > 0.001
    np.testing.assert_allclose(change, pose_change(moving @ turn + 5.0, weights, FPS), atol=1e-9)


def test_joints_that_are_missing_change_nothing() -> None:
    moving = pose_at(np.arange(0, 3, 1 / FPS))
    weights = np.ones(moving.shape[:2])
    weights[:, 4] = 0.0
    gone = moving.copy()
    gone[:, 4] = np.nan
    changed = moving.copy()
    changed[:, 4] += 7.0
    np.testing.assert_allclose(
        pose_change(gone, weights, FPS), pose_change(changed, weights, FPS), atol=1e-12
    )


@pytest.mark.parametrize("frames", [1, 2, 3, 10])
def test_short_videos_have_a_change(frames: int) -> None:
    change = pose_change(pose_at(np.arange(frames) / FPS), np.ones((frames, 12)), FPS)
    assert change.shape == (frames,)
    assert not np.isnan(change).any()


TRUNK = (0, 1, 2, 3)


def jumps(T: int, offset_s: float, height_m: float = 0.15) -> np.ndarray:
    """Height (T,) of somebody who jumps twice a second."""
    return height_m * np.sin(4 * np.pi * (np.arange(T) / FPS - offset_s))


def still_poses(T: int, seed: int) -> np.ndarray:
    """A pose that only an estimator's errors change, (T, 6, 3) metres."""
    pose = np.random.default_rng(0).normal(scale=0.3, size=(6, 3))
    return pose + np.random.default_rng(seed).normal(scale=0.01, size=(T, 6, 3))


def test_landings_fall_on_landings_where_the_pose_does_not_change() -> None:
    T, late_s = 75, 0.2
    poses = [still_poses(T, 1), still_poses(T, 2)]
    heights = [jumps(T, 0.0), jumps(T, late_s, 0.25)]
    evidence = SyncEvidence(poses, [FPS] * 2, heights=heights, reference=0)
    sync = synchronise(evidence, replace(PARAMS, outliers="ignore"), np.random.default_rng(0))
    there = jumps(T, 0.0)[np.rint(sync.reference_frame[1][10:65]).astype(int)]
    assert np.corrcoef(there, heights[1][10:65])[0, 1] > 0.95


def test_heights_in_metres_whatever_the_size_in_the_picture() -> None:
    T = 40
    poses, height = still_poses(T, 1), jumps(T, 0.0)
    for focal in (200.0, 700.0):
        xy = focal * (poses[..., :2] - np.array([0.0, 1.0]) * height[:, None, None])
        found = picture_heights(xy, np.ones((T, 6)), poses, TRUNK, FPS)
        found = found + poses[:, :4, 1].mean(axis=1)  # without the pose's own change
        assert np.corrcoef(found, height)[0, 1] > 0.999
        assert np.ptp(found) == pytest.approx(np.ptp(height), rel=0.03)


def test_heights_without_size_or_trunk_are_unknown() -> None:
    poses, weight = still_poses(5, 1), np.ones((5, 6))
    weight[2, 0] = 0.0
    xy = 100.0 * poses[..., :2]
    assert np.isnan(picture_heights(xy, weight, poses, TRUNK, FPS)).tolist() == [0, 0, 1, 0, 0]
    assert np.isnan(picture_heights(0.0 * xy, weight, poses, TRUNK, FPS)).all()


def test_a_drifting_camera_is_no_vertical_motion() -> None:
    time_s = np.arange(300) / FPS
    drift, jumping = 0.3 * np.sin(2 * np.pi * time_s / 20.0), jumps(300, 0.0)
    moved = vertical_motion(jumping + drift, FPS)
    inside = slice(15, -15)
    assert np.abs(moved - jumping)[inside].max() < 0.2 * np.abs(jumping).max()


def test_who_stays_on_the_ground_changes_no_distance() -> None:
    poses = [still_poses(60, 1), still_poses(60, 2)]
    plain = distance_matrix(poses, None, [FPS] * 2, PARAMS)
    noise = [np.random.default_rng(v).normal(scale=0.01, size=60) for v in (3, 4)]
    still = distance_matrix(poses, None, [FPS] * 2, PARAMS, heights=noise)
    one_jumps = [jumps(60, 0.0), noise[1]]
    jumping = distance_matrix(poses, None, [FPS] * 2, PARAMS, heights=one_jumps)
    unknown = distance_matrix(poses, None, [FPS] * 2, PARAMS, heights=[np.full(60, np.nan)] * 2)
    least = PARAMS.least_difference_m**2
    np.testing.assert_array_equal(unknown.block(0, 1), plain.block(0, 1))
    for distances in (still, jumping):
        assert np.abs(distances.block(0, 1) - plain.block(0, 1)).mean() < 0.05 * least


def test_all_videos_get_the_smallest_amplitude() -> None:
    motions = of_one_amplitude([jumps(90, 0.0, 0.4), jumps(90, 0.1, 0.2)], 0.04)
    tops = [np.abs(m).max() for m in motions]
    assert tops[0] == pytest.approx(tops[1], rel=0.02)
    assert 0.19 < tops[0] < 0.2


def test_differences_and_means_of_what_is_known() -> None:
    a, b = np.array([0.0, np.nan]), np.array([3.0, 4.0])
    np.testing.assert_array_equal(squared_differences(a, b), [[9.0, 16.0], [0.0, 0.0]])
    np.testing.assert_array_equal(mean_of_known([a, b])[:1], [1.5])
    assert mean_of_known([a, a * np.nan])[1:].tolist() == pytest.approx([np.nan], nan_ok=True)
    np.testing.assert_allclose(spread_over(np.array([0.0, 1.0]), None, 4), [0, 0.25, 0.5, 0.75, 1])


PHASE = np.linspace(0.5, 4.5, 120)
BEGIN, LENGTH = 60, 30


def frozen(values: np.ndarray, begin: int = BEGIN, length: int = LENGTH) -> np.ndarray:
    """The frames of a video that shows frame `begin` for `length` frames."""
    again = np.repeat(values[begin : begin + 1], length - 1, axis=0)
    return np.concatenate([values[: begin + 1], again, values[begin + 1 :]])


def test_runs_are_found_where_nothing_moves() -> None:
    poses = estimated(PHASE, np.random.default_rng(1))
    visible = np.ones(poses.shape[:2], dtype=bool)
    assert frozen_runs(poses, visible, FPS) == []
    held = frozen(poses)
    runs = frozen_runs(held, np.ones(held.shape[:2], dtype=bool), FPS)
    assert runs == [(BEGIN, BEGIN + LENGTH - 1)]


@pytest.mark.parametrize("jitter_m", [0.001, 0.01])
def test_a_person_who_stands_still_is_no_freeze_frame(jitter_m: float) -> None:
    rng = np.random.default_rng(2)
    still = frozen(estimated(PHASE, rng))
    still[BEGIN : BEGIN + LENGTH] += jitter_m * rng.normal(size=(LENGTH, 12, 3))
    assert frozen_runs(still, np.ones(still.shape[:2], dtype=bool), FPS) == []


def test_undetected_and_twice_shown_frames_are_none() -> None:
    poses = estimated(PHASE, np.random.default_rng(3))
    missing = poses.copy()
    missing[40:80] = np.nan
    visible = np.isfinite(missing).all(-1)
    assert frozen_runs(missing, visible, FPS) == []
    twice = np.repeat(poses, 2, axis=0)
    assert frozen_runs(twice, np.ones(twice.shape[:2], dtype=bool), 2 * FPS) == []


def test_positions_lead_to_the_frames_of_the_pictures_and_back() -> None:
    pictures = distinct_frames([(3, 6), (9, 11)], 12)
    assert pictures.runs == [(3, 6), (9, 11)]
    assert pictures.times_shown.tolist() == [1, 1, 1, 4, 4, 4, 4, 1, 1, 3, 3, 3]
    positions = np.array([0.5, 3.0, 3.5, 4.0, 6.0, np.nan])
    np.testing.assert_array_equal(pictures.in_frames(positions), [0.5, 3.0, 6.5, 7.0, 9.0, np.nan])
    every = pictures.in_frames(pictures.picture.astype(float))
    assert (pictures.picture[every.astype(int)] == pictures.picture).all()


@pytest.mark.long
def test_a_freeze_frame_has_one_moment_and_the_rest_is_as_without_it() -> None:
    rng = np.random.default_rng(4)
    other, poses = estimated(np.linspace(0.4, 4.6, 126), rng), estimated(PHASE, rng)
    plain = run([other, poses], reference=0)
    result = run([other, frozen(poses)], reference=0)
    expected = frozen(plain.reference_frame[1])
    np.testing.assert_allclose(result.reference_frame[1], expected)
    np.testing.assert_allclose(result.phase[1], frozen(plain.phase[1]))
    held = slice(BEGIN, BEGIN + LENGTH)
    assert np.ptp(result.reference_frame[1][held]) == 0.0
    # together they are one observation
    assert result.confidence[1][held].sum() == pytest.approx(plain.confidence[1][BEGIN])
    assert result.relaxed.pair(0, 1).shape == (126, 149)
    assert result.affinity.pairs[0, 1].shape == (126, 149)


@pytest.mark.long
@pytest.mark.parametrize("reference", [None, 1])
def test_a_held_last_frame_and_a_frozen_reference(reference: int | None) -> None:
    rng = np.random.default_rng(5)
    phases = [np.linspace(0.4, 4.6, 126), frozen(PHASE, 119), np.linspace(0.5, 4.4, 110)]
    poses = [estimated(phases[0], rng), frozen(estimated(PHASE, rng), 119), None]
    poses[2] = estimated(phases[2], rng)
    result = run(poses, reference=reference)
    if reference is None:
        assert result.reference != 1  # while another video can be
        assert np.ptp(result.reference_frame[1][119:]) == 0.0
    else:
        np.testing.assert_array_equal(result.reference_frame[1], np.arange(149.0))
    assert error_s(phases, result.reference_frame, result.reference).mean() < 0.04


def test_hints_are_those_of_the_pictures() -> None:
    pictures = [distinct_frames([(3, 6)], 12), distinct_frames([], 10)]
    hints = Hints((Anchor(0, 5, 1, 2.5), Anchor(0, 8, 1, 6.0)), ((0, 4, 9), (1, 2, 4)))
    moved = hints_of_pictures(hints, pictures)
    assert [(a.frame_a, a.frame_b) for a in moved.anchors] == [(3, 2.5), (5, 6.0)]
    assert moved.forbidden == ((0, 3, 6), (1, 2, 4))


def test_what_stays_of_a_video_is_taken_off_and_what_shows_a_part_is_kept() -> None:
    poses = pose_at(np.linspace(0, 6, 90))
    poses -= poses.mean(axis=1, keepdims=True)
    weights, off = [np.ones(poses.shape[:2])] * 3, np.random.default_rng(4).normal(size=(12, 3))
    bent = poses + 3.0 * poses.std(axis=0).mean() * off
    turn = Rotation.from_rotvec([0.0, 1.0, 0.2]).as_matrix()

    alike = [poses, poses @ turn, poses]
    np.testing.assert_array_equal(of_one_mean(alike, weights), alike)
    corrected = of_one_mean([poses, bent @ turn, poses], weights)
    apart, left = (
        procrustes_distances(x[0], x[1], *weights[:2]).diagonal().mean()
        for x in ([poses, bent @ turn], corrected)
    )
    assert 0.3 * apart < left < 0.65 * apart

    kept = of_one_mean([poses, poses[:12], poses], [weights[0], weights[0][:12], weights[0]])
    assert np.abs(kept[1] - poses[:12]).mean() < 0.2 * np.abs(kept[1] - poses.mean(axis=0)).mean()

    hidden = poses.copy()
    hidden[:, 3], hidden[40:50] = np.nan, np.nan
    without = of_one_mean([poses, hidden], [weights[0], np.isfinite(hidden[..., 0]) * 1.0])
    np.testing.assert_allclose(without[0], poses, atol=0.02)
    assert np.isnan(without[1]).sum() == np.isnan(hidden).sum()
