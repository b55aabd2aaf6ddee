"""Playback rates from poses: slow motion and time lapse, and no rate where speeds are usual."""

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.sync import SyncEvidence, estimated_rates
from imocap_core.sync.warp.rate import log_playback_rates, playback_rates
from imocap_core.sync.warp.soft_maps import Clocks
from tests.sync.test_synchronise import FPS, PARAMS, error_s, estimated, pose_at, run

QUICK = replace(PARAMS, consensus_rounds=0)
SPEEDS = [1.0, 1.1, 0.9, 1.2]


def videos(
    speeds: list[float], seed: int, seconds: float = 5.0
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Phases and estimates of one action, each video at its own speed."""
    rng = np.random.default_rng(seed)
    phases = [np.arange(0.1 * v, seconds, s / FPS) for v, s in enumerate(speeds)]
    poses = [pose_at(p) + 0.03 * rng.normal(size=(len(p), 12, 3)) for p in phases]
    return phases, poses


def rates_of(poses: list[np.ndarray], fps: list[float]) -> np.ndarray:
    return playback_rates(poses, [np.ones(x.shape[:2]) for x in poses], fps, 32.0)


@pytest.mark.parametrize("factor", [1 / 8, 4.0])
def test_the_rate_of_a_retimed_video_is_found(factor: float) -> None:
    _, poses = videos([1.0, factor, 0.9, 1.1], 0)
    rates = rates_of(poses, [FPS] * 4)
    assert rates[1] == pytest.approx(factor, rel=0.15)
    np.testing.assert_array_equal(rates[[0, 2, 3]], 1.0)


def test_usual_speeds_are_left_alone() -> None:
    _, poses = videos(SPEEDS, 1)
    np.testing.assert_array_equal(rates_of(poses, [FPS] * 4), 1.0)


def test_the_frame_rate_of_a_file_is_no_playback_rate() -> None:
    """A file of four times the frames and four times the frame rate plays at the usual speed."""
    _, poses = videos([1.0, 0.25, 0.9], 2)
    np.testing.assert_array_equal(rates_of(poses, [FPS, 4 * FPS, FPS]), 1.0)


def test_of_two_videos_the_slower_one_is_in_slow_motion() -> None:
    _, poses = videos([1.0, 1 / 6], 3)
    for order in ([0, 1], [1, 0]):
        rates = rates_of([poses[v] for v in order], [FPS, FPS])
        assert rates[order.index(0)] == 1.0
        assert rates[order.index(1)] == pytest.approx(1 / 6, rel=0.15)


def test_unrelated_poses_have_no_rate() -> None:
    rng = np.random.default_rng(4)
    poses = [rng.normal(size=(n, 12, 3)) for n in (80, 300, 90)]
    np.testing.assert_array_equal(rates_of(poses, [FPS] * 3), 1.0)


def test_one_video_and_videos_of_one_frame_have_the_usual_rate() -> None:
    _, poses = videos([1.0, 1.0], 5)
    np.testing.assert_array_equal(rates_of(poses[:1], [FPS]), 1.0)
    assert np.isfinite(rates_of([poses[0], poses[1][:1]], [FPS, FPS])).all()


def test_rates_are_relative() -> None:
    """Faster files of all videos alike change nothing."""
    _, poses = videos([1.0, 0.3, 0.9], 6)
    weights = [np.ones(x.shape[:2]) for x in poses]
    plain = log_playback_rates(poses, weights, [FPS] * 3)[0]
    double = log_playback_rates(poses, weights, [2 * FPS] * 3)[0]
    assert np.ptp(plain - double) < 0.1


def error_at(speed: float) -> float:
    """The mean error in seconds of the second video, played at this speed."""
    phases, _ = videos([1.0, speed, 0.9], 7, seconds=3.0)
    rng = np.random.default_rng(8)
    poses = [estimated(p, rng) for p in phases]
    result = run(poses, PARAMS, reference=0)
    return float(error_s([phases[0], phases[1]], result.reference_frame[:2], 0).mean())


def test_slow_motion_is_as_accurate_as_the_usual_speed() -> None:
    assert error_at(1.0 / 5.0) < 1.3 * error_at(1.0) + 0.003


def test_the_reference_plays_at_the_usual_speed() -> None:
    _, poses = videos([1 / 5, 1.0, 0.9], 9, seconds=3.0)
    assert run(poses, QUICK).reference != 0


def test_clocks_tell_the_action_s_time() -> None:
    clocks = Clocks([30.0, 60.0], np.array([1.0, 0.25]))
    assert clocks.action_fps == [30.0, 240.0]
    assert clocks.evidence_fps == [30.0, 120.0]


def test_rates_that_were_estimated_before_give_the_same_maps() -> None:
    _, poses = videos([1.0, 0.25], 4, seconds=3.0)
    params = replace(QUICK, max_rate=32.0)
    given = estimated_rates(SyncEvidence(poses, [FPS] * 2), params)
    assert given[1] < 0.5
    plain, again = run(poses, params), run(poses, params, rates=given)
    for a, b in zip(plain.reference_frame, again.reference_frame, strict=True):
        np.testing.assert_array_equal(a, b)
    usual = run(poses, params, rates=np.ones(2))
    assert any(
        not np.array_equal(a, b, equal_nan=True)
        for a, b in zip(plain.reference_frame, usual.reference_frame, strict=True)
    )
