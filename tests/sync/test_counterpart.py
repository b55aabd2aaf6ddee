"""Which frames have a counterpart: stillness is no evidence against one, other content is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.sync.comparable_poses import pose_change
from imocap_core.sync.warp.soft_maps import evidence_of_match
from tests.sync.test_synchronise import FPS, PARAMS, pose_at, run

OPTIONS = {"matched_square": 0.002, "level": 1.0, "observations": 0.5}


def standing_first(phase: np.ndarray, rng: np.random.Generator, error_m: float) -> np.ndarray:
    """An estimate of a performer who stands still while the phase is below 0; standing, it errs by
    a pose of its own, as long as that lasts."""
    pose = pose_at(np.maximum(phase, 0.0)) + 0.02 * rng.normal(size=(len(phase), 12, 3))
    share = np.clip(1.0 - phase / 0.5, 0.0, 1.0)[:, None, None]
    turn = Rotation.random(random_state=int(rng.integers(1000))).as_matrix()
    return np.asarray((pose + share * error_m * rng.normal(size=(12, 3))) @ turn)


@pytest.mark.parametrize("error_m", [0.03, 0.08, 0.12])
def test_a_performer_who_stands_still_is_matched_however_wrong_the_pose(error_m: float) -> None:
    rng = np.random.default_rng(1)
    phases = [np.arange(-3 - 0.3 * v, 3, (1 + 0.1 * v) / FPS) for v in range(3)]
    videos = [standing_first(p, rng, error_m) for p in phases]
    result = run(videos, replace(PARAMS, max_rate=32.0), reference=0)
    for phase, frames in zip(phases[1:], result.reference_frame[1:], strict=True):
        assert np.isfinite(frames[phase < 0]).mean() > 0.9
        assert np.isfinite(frames[phase >= 0]).all()


def test_a_video_that_stands_before_the_others_begin_is_unmatched_there() -> None:
    rng = np.random.default_rng(2)
    phases = [np.arange(s, 4, 1 / FPS) for s in (0.0, -3.0, 0.1)]
    videos = [standing_first(p, rng, 0.03) for p in phases]
    result = run(videos, replace(PARAMS, max_rate=32.0), reference=0)
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
