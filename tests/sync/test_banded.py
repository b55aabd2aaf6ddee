"""Products with soft maps leave out only what rounding would lose anyway."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.sync.maps import FRAMES, BandedMap
from imocap_core.sync.warp.monotone import monotone_posterior

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
