"""DTW: the cheapest path indeed, monotone, and the same when the videos swap."""

import itertools

import numpy as np
import pytest

from imocap_core.sync.warp.dtw import dtw, positions_of_rows


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
