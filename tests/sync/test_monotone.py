"""The mean over all monotone warps, against listing them."""

import itertools

import numpy as np
import pytest

from imocap_core.sync.maps import BandedMap
from imocap_core.sync.warp.monotone import ANY_STEP, StepPrior, monotone_posterior
from imocap_core.sync.warp.soft_maps import at_fine_positions


def posterior_naive(cost: np.ndarray, steps: StepPrior) -> np.ndarray:
    """Every non-decreasing sequence of positions, weighted by its steps and exp(-cost)."""
    n, S = cost.shape
    out = np.zeros((n, S))
    for warp in itertools.combinations_with_replacement(range(S), n):
        step = np.diff(warp)
        prior = np.where(step <= steps.usual, 1.0, np.where(step <= steps.largest, steps.leap, 0.0))
        out[np.arange(n), warp] += prior.prod() * np.exp(-cost[np.arange(n), warp].sum())
    return out / out.sum(axis=1, keepdims=True)


@pytest.mark.parametrize(
    "steps", [ANY_STEP, StepPrior(1, 1, 0.0), StepPrior(2, 2, 0.3), StepPrior(1, 3, 0.2)]
)
def test_is_the_mean_over_all_warps(steps: StepPrior) -> None:
    cost = 3.0 * np.random.default_rng(0).random((5, 6))
    maps, matched = monotone_posterior(cost, unmatched=np.inf, steps=steps)
    np.testing.assert_allclose(maps, posterior_naive(cost, steps), atol=1e-9)
    np.testing.assert_allclose(matched, 1.0)


def test_impossible_steps_are_refused() -> None:
    with pytest.raises(ValueError, match="usual <= largest"):
        StepPrior(3, 2, 0.5)


def test_a_hold_is_spread_evenly() -> None:
    """Nothing tells the frames apart: their expected positions are evenly spaced, not bunched."""
    maps, _ = monotone_posterior(np.zeros((40, 81)), unmatched=np.inf)
    expected = maps @ np.arange(81.0)
    np.testing.assert_allclose(np.diff(expected), 80 / 41, atol=0.1)


def test_frames_outside_are_unmatched() -> None:
    moment_a, moment_b = np.arange(-15.0, 40.0), np.arange(0.0, 60.0)
    cost = 0.5 * np.minimum((moment_a[:, None] - moment_b) ** 2, 40.0)
    maps, matched = monotone_posterior(cost, unmatched=6.0)
    assert (matched[:12] < 0.1).all()
    assert (matched[17:] > 0.9).all()
    np.testing.assert_allclose((maps @ moment_b)[18:], moment_a[18:], atol=1.0)


def test_time_reversal_reverses() -> None:
    cost = 2.0 * np.random.default_rng(3).random((30, 25))
    maps, matched = monotone_posterior(cost, unmatched=0.8)
    back, matched_back = monotone_posterior(cost[::-1, ::-1], unmatched=0.8)
    np.testing.assert_allclose(back[::-1, ::-1], maps, atol=1e-9)
    np.testing.assert_allclose(matched_back[::-1], matched, atol=1e-9)


def test_fine_positions_interpolate_the_map_and_sum_to_one() -> None:
    soft_map = np.random.default_rng(4).dirichlet(np.ones(5), 6)
    fine = at_fine_positions(BandedMap.of(soft_map), 4).dense()
    positions = np.arange(17) / 4
    expected = np.stack([np.interp(positions, np.arange(5), row) for row in soft_map])
    np.testing.assert_allclose(fine, expected / expected.sum(axis=1, keepdims=True), atol=1e-12)
