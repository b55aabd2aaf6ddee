"""Even moments in a video of uneven frames."""

from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imocap_core.sequences import (
    BRIDGED_S,
    even_moments,
    is_constant_rate,
    points_at_moments,
    typical_step_s,
    viterbi,
)

STEPS = st.lists(st.floats(0.01, 0.09), min_size=3, max_size=60)


@given(STEPS)
def test_moments_are_even_increasing_and_within_the_video(steps):
    time_s = np.concatenate([[0.0], np.cumsum(steps)])
    moments = even_moments(time_s)
    assert moments.position[0] == 0
    assert (np.diff(moments.position) >= 0).all()
    assert moments.position[-1] <= len(steps)
    assert np.diff(moments.time_s) == pytest.approx(1 / moments.fps, rel=0.3)
    assert time_s[-1] - moments.time_s[-1] < 1 / moments.fps


@given(STEPS)
def test_uniform_movement_stays_uniform(steps):
    """A point of constant velocity is at any moment where it should be."""
    time_s = np.concatenate([[0.0], np.cumsum(steps)])
    moments = even_moments(time_s)
    points = 3.0 + 200.0 * time_s[:, None]
    np.testing.assert_allclose(
        points_at_moments(points, moments, time_s)[:, 0], 3.0 + 200.0 * moments.time_s
    )


def test_frames_of_a_constant_rate_are_the_moments():
    time_s = np.arange(50) / 24
    moments = even_moments(time_s)
    np.testing.assert_allclose(moments.position, np.arange(50), atol=1e-9)
    assert moments.fps == pytest.approx(24)


def test_nothing_is_made_up_in_a_long_interval():
    time_s = np.r_[np.arange(10) / 30, 9 / 30 + 0.5 + np.arange(10) / 30]
    moments = even_moments(time_s)
    at = points_at_moments(np.ones((20, 1)), moments, time_s)[:, 0]
    away = np.abs(moments.time_s[:, None] - time_s).min(axis=1)
    assert np.isfinite(at[away <= 0.25 / 30]).all()
    assert np.isnan(at[away > 0.5 / 30]).all()
    assert np.isnan(at).sum() == pytest.approx(0.5 * 30 - 1, abs=1)


def test_a_frame_without_a_detection_is_not_bridged_over():
    time_s = np.array([0, 1, 2, 3.5, 4.5, 5.5, 6.5]) / 30
    points = np.arange(7.0)[:, None]
    points[1] = np.nan
    at = points_at_moments(points, even_moments(time_s), time_s)[:, 0]
    assert np.flatnonzero(np.isnan(at)).tolist() == [1]


@pytest.mark.parametrize(
    ("fps", "constant"), [(30.0, True), (30.1, True), (28.5, False), (24.0, False)]
)
def test_a_header_that_is_a_little_wrong_is_right(fps, constant):
    assert is_constant_rate(np.arange(900) / 30, fps) is constant


@given(st.floats(-0.2, 0.2), st.integers(1, 58))
def test_a_frame_that_is_hardly_late_makes_no_variable_rate(late, frame):
    time_s = np.arange(60) / 30
    time_s[frame] += late / 30
    assert is_constant_rate(time_s, 30.0)


def test_the_typical_step_is_that_of_most_frames():
    time_s = np.cumsum(np.r_[np.full(40, 0.033), np.full(20, 0.034), np.full(10, BRIDGED_S)])
    assert typical_step_s(time_s) == pytest.approx((40 * 0.033 + 20 * 0.034) / 60, rel=1e-2)


def cost(states: tuple[int, ...], first: np.ndarray, steps: np.ndarray) -> float:
    moves = zip(steps, pairwise(states), strict=True)
    return float(first[states[0]] + sum(step[a, b] for step, (a, b) in moves))


def test_no_other_sequence_is_cheaper() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        first, steps = rng.random(3), rng.random((4, 3, 3))
        best = tuple(int(state) for state in viterbi(first, steps))
        every = product(range(3), repeat=5)
        assert best == min(every, key=lambda states: cost(states, first, steps))


def test_one_frame_is_in_its_cheapest_state() -> None:
    assert viterbi(np.array([2.0, 1.0]), np.zeros((0, 2, 2))).tolist() == [1]
