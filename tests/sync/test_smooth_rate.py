"""Warps of slowly changing rate, against listing them all."""

import itertools

import numpy as np
import pytest

from imocap_core.sync.maps import whole_band
from imocap_core.sync.warp.monotone import monotone_posterior
from imocap_core.sync.warp.rate import RatePrior, banded_rate_posterior, rate_prior

PRIOR = RatePrior(
    np.array([0.5, 1.0, 2.0]),
    np.array([0.2, 0.5, 0.3]),
    np.array([[0.7, 0.2, 0.1], [0.1, 0.8, 0.1], [0.0, 0.3, 0.7]]),
)


def posterior_naive(cost: np.ndarray, prior: RatePrior, skipped: float) -> np.ndarray:
    """Every sequence of positions and rates, weighted by its probability and exp(-cost)."""
    n, S = cost.shape
    out = np.zeros((n, S))
    states = list(itertools.product(range(S), range(len(prior.share))))
    for path in itertools.product(states, repeat=n):
        weight = prior.share[path[0][1]] * np.exp(-skipped * (path[0][0] + S - 1 - path[-1][0]))
        for (a, k), (b, m) in itertools.pairwise(path):
            whole = int(prior.advance[k])
            part = prior.advance[k] - whole
            step = {whole: 1 - part, whole + 1: part}.get(b - a, 0.0)
            weight *= step * prior.moves[k, m]
        positions = [s for s, _ in path]
        out[np.arange(n), positions] += weight * np.exp(-cost[np.arange(n), positions].sum())
    return out / out.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("skipped", [0.0, 0.7])
def test_is_the_mean_over_all_warps(skipped: float) -> None:
    cost = 2.0 * np.random.default_rng(0).random((4, 5))
    maps, matched = banded_rate_posterior(
        whole_band(cost), PRIOR, unmatched=np.inf, skipped=skipped
    )
    np.testing.assert_allclose(maps.dense(), posterior_naive(cost, PRIOR, skipped), atol=1e-9)
    np.testing.assert_allclose(matched, 1.0, atol=1e-6)


def test_rates_keep_their_shares_and_limits() -> None:
    rates = rate_prior(usual=4.0, spread=0.35, persistence_s=1.0, max_rate=3.0, fps=30.0)
    np.testing.assert_allclose(rates.moves.sum(axis=1), 1.0)
    np.testing.assert_allclose(rates.share @ rates.moves, rates.share, atol=1e-9)
    assert rates.advance.min() >= 4.0 / 3.0 - 1e-9
    assert rates.advance.max() <= 12.0 + 1e-9


def test_a_false_hold_bends_the_warp_less_than_all_monotone_warps_do() -> None:
    t = np.arange(120.0)
    cost = 0.2 * np.minimum((t[:, None] - t) ** 2, 60.0)
    cost[40:70] = 0.02 * np.minimum((40.0 - t) ** 2, 60.0)  # as if the pose stood still
    rates = rate_prior(usual=1.0, spread=0.2, persistence_s=2.0, max_rate=4.0, fps=30.0)
    even = banded_rate_posterior(whole_band(cost), rates, unmatched=40.0)[0].dense()
    any_, _ = monotone_posterior(cost, unmatched=40.0)
    assert np.diff(even @ t)[5:-5].max() < 0.7 * np.diff(any_ @ t)[5:-5].max()
    assert np.abs(even @ t - t).mean() < 0.7 * np.abs(any_ @ t - t).mean()


def test_impossible_rates_are_refused() -> None:
    with pytest.raises(ValueError, match="expected > 0"):
        rate_prior(usual=0.0, spread=0.3, persistence_s=1.0, max_rate=4.0, fps=30.0)
