"""DTW: the cheapest path indeed, monotone, the same when the videos swap; and the mean over all
monotone warps, against listing them."""

import itertools

import numpy as np
import pytest

from imocap_core.sync.maps import FRAMES, BandedMap, whole_band
from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.sync.warp.monotone import ANY_STEP, StepPrior, banded_posterior
from imocap_core.sync.warp.rate import RatePrior, banded_rate_posterior, rate_prior
from imocap_core.sync.warp.soft_maps import at_fine_positions, step_prior


def monotone_posterior(cost: np.ndarray, **given) -> tuple[np.ndarray, np.ndarray]:
    posterior, matched = banded_posterior(whole_band(cost), **given)
    return posterior.values[0], matched


def best_total_naive(cost: np.ndarray, skip: float) -> float:
    """Cell by cell; every start and end on the borders."""
    n, m = cost.shape
    total = np.full((n, m), np.inf)
    best = np.inf
    for i, j in itertools.product(range(n), range(m)):
        starts = (i == 0 and j == 0) or (np.isfinite(skip) and (i == 0 or j == 0))
        if starts:
            total[i, j] = 2 * cost[i, j] + (skip * (i + j) if i + j else 0.0)
        if i and j:
            total[i, j] = min(total[i, j], total[i - 1, j - 1] + 2 * cost[i, j])
        if i:
            total[i, j] = min(total[i, j], total[i - 1, j] + cost[i, j])
        if j:
            total[i, j] = min(total[i, j], total[i, j - 1] + cost[i, j])
        left = (n - 1 - i) + (m - 1 - j)
        if left == 0 or (np.isfinite(skip) and (i == n - 1 or j == m - 1)):
            best = min(best, total[i, j] + (skip * left if left else 0.0))
    return float(best)


@pytest.mark.parametrize("skip", [np.inf, 0.0, 0.2, 0.6])
@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (7, 1), (9, 13), (20, 8)])
def test_is_the_cheapest_path(shape: tuple[int, int], skip: float) -> None:
    cost = np.random.default_rng(sum(shape)).random(shape)
    path, total = dtw(cost, skip=skip)
    assert total == pytest.approx(best_total_naive(cost, skip), rel=1e-9)
    steps = np.diff(path, axis=0)
    assert ((steps >= 0) & (steps <= 1)).all()
    assert (steps.sum(axis=1) >= 1).all()
    swapped, total_swapped = dtw(cost.T, skip=skip)
    assert total_swapped == pytest.approx(total)
    np.testing.assert_array_equal(swapped[:, ::-1], path)


def test_open_ends_find_the_shared_part() -> None:
    a, b = np.arange(0.0, 30.0), np.arange(12.0, 50.0)
    path, _ = dtw(np.abs(a[:, None] - b[None, :]), skip=0.5)
    np.testing.assert_array_equal(path[:, 0] - 12, path[:, 1])
    positions = positions_of_rows(path, 30)
    assert np.isnan(positions[:12]).all()
    np.testing.assert_array_equal(positions[12:], np.arange(18.0))


def test_unknown_costs_do_not_stop_a_path() -> None:
    cost = np.abs(np.arange(10.0)[:, None] - np.arange(10.0))
    cost[4] = np.nan
    path, _ = dtw(cost)
    assert path[0].tolist() == [0, 0]
    assert path[-1].tolist() == [9, 9]


def test_an_empty_cost_is_refused() -> None:
    with pytest.raises(ValueError, match="expected a matrix"):
        dtw(np.zeros((0, 3)))


@pytest.mark.parametrize(
    "steps", [ANY_STEP, StepPrior(1, 1, 0), StepPrior(1, 3, 0.2), StepPrior(9, 9, 1, 0.3)]
)
def test_is_the_mean_over_all_warps(steps: StepPrior) -> None:
    cost = 3.0 * np.random.default_rng(0).random((5, 6))
    maps, matched = monotone_posterior(cost, unmatched=np.inf, steps=steps)
    # every non-decreasing sequence of positions, weighted by its steps and exp(-cost)
    n, S = cost.shape
    out = np.zeros((n, S))
    for warp in itertools.combinations_with_replacement(range(S), n):
        step = np.diff(warp)
        leaps = np.where(step <= steps.usual, 1.0, np.where(step <= steps.largest, steps.leap, 0.0))
        prior = leaps * steps.decay**step
        out[np.arange(n), warp] += prior.prod() * np.exp(-cost[np.arange(n), warp].sum())
    np.testing.assert_allclose(maps, out / out.sum(axis=1, keepdims=True), atol=1e-9)
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


def test_a_fast_camera_s_short_clip_is_matched_within_a_long_one() -> None:
    """That the long one goes on with other content is no reason to match nothing."""
    moment, position = np.arange(20, 100) / 2.0, np.arange(200.0)  # half a position a frame
    cost = 0.25 * np.minimum((moment[:, None] - 10.0 - position) ** 2, 5.0)
    maps, matched = monotone_posterior(cost, unmatched=0.65, steps=step_prior(0.5, 32.0))
    assert matched.mean() > 0.9
    np.testing.assert_allclose((maps @ position)[4:-4], moment[4:-4] - 10.0, atol=1.5)


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


PRIOR = RatePrior(
    np.array([0.5, 1.0, 2.0]),
    np.array([0.2, 0.5, 0.3]),
    np.array([[0.7, 0.2, 0.1], [0.1, 0.8, 0.1], [0.0, 0.3, 0.7]]),
)


@pytest.mark.parametrize("skipped", [0.0, 0.7])
def test_is_the_mean_over_all_warps_of_smooth_rate(skipped: float) -> None:
    cost = 2.0 * np.random.default_rng(0).random((4, 5))
    maps, matched = banded_rate_posterior(
        whole_band(cost), PRIOR, unmatched=np.inf, skipped=skipped
    )
    # every sequence of positions and rates, weighted by its probability and exp(-cost)
    n, S = cost.shape
    out = np.zeros((n, S))
    states = list(itertools.product(range(S), range(len(PRIOR.share))))
    for path in itertools.product(states, repeat=n):
        weight = PRIOR.share[path[0][1]] * np.exp(-skipped * (path[0][0] + S - 1 - path[-1][0]))
        for (a, k), (b, m) in itertools.pairwise(path):
            whole = int(PRIOR.advance[k])
            part = PRIOR.advance[k] - whole
            step = {whole: 1 - part, whole + 1: part}.get(b - a, 0.0)
            weight *= step * PRIOR.moves[k, m]
        positions = [s for s, _ in path]
        out[np.arange(n), positions] += weight * np.exp(-cost[np.arange(n), positions].sum())
    np.testing.assert_allclose(maps.dense(), out / out.sum(axis=1, keepdims=True), atol=1e-9)
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


N, S, F = 3 * FRAMES + 5, 400, 7
Array = np.ndarray


def posterior() -> Array:
    """Of a warp at constant rate, whose frames match their positions well."""
    away = np.arange(S) - np.linspace(0, S - 1, N)[:, None]
    return monotone_posterior(np.minimum(0.05 * away**2, 30.0), unmatched=np.inf)[0]


def values(rows: int) -> Array:
    return np.random.default_rng(0).normal(size=(rows, F))


MAPS = {
    "posterior": posterior(),
    "posterior of hardly matched frames": posterior() * np.logspace(0, -40, N)[:, None],
    "identity": np.eye(N, S),
    "uniform": np.full((N, S), 1.0 / S),
    "with frames that are nowhere": np.where(np.arange(N)[:, None] % 3, 0.0, posterior()),
    "nowhere": np.zeros((N, S)),
}


@pytest.mark.parametrize("soft_map", MAPS.values(), ids=MAPS.keys())
def test_products_are_those_of_the_whole_map(soft_map: Array) -> None:
    banded = BandedMap.of(soft_map)
    rows = soft_map.max(axis=1, keepdims=True) + 1e-300
    gathered, spread = banded.gathered(values(S)), banded.spread(values(N))
    np.testing.assert_allclose(gathered / rows, soft_map @ values(S) / rows, rtol=0, atol=1e-12)
    np.testing.assert_allclose(spread, soft_map.T @ values(N), rtol=0, atol=1e-14)


def test_only_the_band_is_multiplied() -> None:
    bands = BandedMap.of(MAPS["posterior"]).bands
    entries = sum((r.stop - r.start) * (c.stop - c.start) for r, c in bands)
    assert entries < 0.6 * N * S
    assert [r for r, _ in BandedMap.of(MAPS["uniform"]).bands] == [r for r, _ in bands]
    assert BandedMap.of(MAPS["nowhere"]).bands == []
