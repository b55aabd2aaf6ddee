"""Distances near a map are those of all positions, and the best of all is known."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.sync.maps import FRAMES, BandedMap, search_bands, whole_band
from imocap_core.sync.warp import template
from imocap_core.sync.warp.monotone import StepPrior, banded_posterior, monotone_posterior
from imocap_core.sync.warp.rate import banded_rate_posterior, rate_prior
from imocap_core.sync.warp.template import NearbySquares

N, S = 3 * FRAMES + 5, 260
STEPS = StepPrior(12, 60, 0.05)


def costs() -> np.ndarray:
    """Of a noisy warp at a changing rate."""
    rng = np.random.default_rng(0)
    warp = np.linspace(0, 1, N) ** 1.3 * (S - 1)
    away = np.minimum(0.02 * (np.arange(S) - warp[:, None]) ** 2, 6.0)
    return np.asarray(away + 0.3 * rng.random((N, S)))


@pytest.mark.parametrize("at_once", [1 << 20, 3 * S])
def test_distances_near_a_map_are_those_of_all(
    at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(template, "ENTRIES_AT_ONCE", at_once)
    squares = costs()
    squares[7] = np.nan
    bands = search_bands([BandedMap.of(np.eye(N, S))], 9)
    nearby = NearbySquares.computed((N, S), bands, lambda t, s: squares[t, s])
    for rows, columns, values in nearby.nearby:
        np.testing.assert_array_equal(values, squares[rows, columns])
    assert len(nearby.nearby.bands) == 4
    np.testing.assert_array_equal(nearby.least, squares.min(axis=1))


def test_of_very_many_positions_every_nth_is_compared_and_all_near_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(template, "ALL_COMPARED", N * S // 4)
    squares, compared = costs(), []

    def block(frames: slice, positions: slice) -> np.ndarray:
        part = squares[frames, positions]
        compared.append(part.size)
        return part

    bands = search_bands([BandedMap.of(np.eye(N, S))], 9)
    nearby = NearbySquares.computed((N, S), bands, block)
    assert sum(compared) < 0.6 * N * S
    assert (nearby.least >= squares.min(axis=1)).all()
    for rows, columns, values in nearby.nearby:
        np.testing.assert_array_equal(values, squares[rows, columns])
        assert (nearby.least[rows] <= values.min(axis=1)).all()


def test_warps_within_a_band_are_those_of_all_where_the_others_are_unlikely() -> None:
    cost, unmatched = 4.0 * costs(), np.full(N, 9.0)
    prior = rate_prior(usual=S / N, spread=0.35, persistence_s=1.0, max_rate=8.0, fps=30.0)
    dense, matched = monotone_posterior(cost, unmatched=unmatched, steps=STEPS)
    whole, smooth_matched = banded_rate_posterior(
        whole_band(cost), prior, unmatched=unmatched, skipped=0.1
    )
    smooth = whole.dense()
    both = [BandedMap.of(dense, 1e-12), BandedMap.of(smooth, 1e-12)]
    bands = search_bands(both, 20)
    near = BandedMap.computed((N, S), bands, lambda t, s: cost[t, s])
    assert sum(x.size for x in near.values) < 0.6 * N * S
    banded, banded_matched = banded_posterior(near, unmatched=unmatched, steps=STEPS)
    np.testing.assert_allclose(banded.dense(), dense, atol=1e-9)
    np.testing.assert_allclose(banded_matched, matched, atol=1e-9)
    rates, rates_matched = banded_rate_posterior(near, prior, unmatched=unmatched, skipped=0.1)
    np.testing.assert_allclose(rates.dense(), smooth, atol=1e-9)
    np.testing.assert_allclose(rates_matched, smooth_matched, atol=1e-9)


def test_a_trimmed_map_is_narrow_whatever_bands_it_had() -> None:
    soft_map = monotone_posterior(4.0 * costs(), unmatched=np.inf, steps=STEPS)[0]
    trimmed = whole_band(soft_map).trimmed(1e-6)
    assert [r.stop - r.start for r, _ in trimmed.bands] == [FRAMES] * 3 + [5]
    np.testing.assert_allclose(trimmed.dense(), soft_map, atol=1e-6)
    assert sum(x.size for x in trimmed.values) < 0.5 * N * S
