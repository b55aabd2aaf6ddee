"""The reference: central, and showing as much of the others as that allows, in any order."""

from itertools import permutations

import numpy as np
import pytest

from imocap_core.sync.maps import Blocks
from imocap_core.sync.reference import chosen_reference, coverage
from imocap_core.sync.time_axis import PairMaps, pace_spread
from imocap_core.sync.warp.soft_maps import Clocks

CENTRAL, COVERING = np.array([0.52, 0.50, 0.45, 0.20]), np.array([0.90, 0.98, 0.95, 1.0])


def chosen(central: np.ndarray, covering: np.ndarray, eligible: list[bool]) -> int:
    """Of videos whose pace is alike."""
    return chosen_reference(central, np.full(4, 0.2), covering, eligible)


def test_it_shows_most_among_the_central_videos_in_any_order() -> None:
    for order in permutations(range(4)):
        rows = list(order)
        assert rows[chosen(CENTRAL[rows], COVERING[rows], [True] * 4)] == 1


@pytest.mark.parametrize("seed", range(5))
def test_small_changes_of_centrality_do_not_move_it(seed: int) -> None:
    change = np.random.default_rng(seed).uniform(-0.04, 0.04, 4)
    assert chosen(CENTRAL + change, COVERING, [True] * 4) == 1


def test_the_most_central_of_videos_that_show_as_much_is_taken() -> None:
    assert chosen(CENTRAL, np.full(4, 0.95), [True] * 4) == 0


def test_only_eligible_videos_are_taken_unless_none_is() -> None:
    assert chosen(CENTRAL, COVERING, [True, False, True, True]) == 2
    assert chosen(CENTRAL, COVERING, [False] * 4) == 1


def test_coverage_is_the_mean_share_of_each_other_videos_frames() -> None:
    matched = np.array([[1.0, 0.5], [1.0, 0.5], [0.25, 1.0], [0.75, 1.0], [0.5, 1.0], [0.5, 1.0]])
    np.testing.assert_allclose(coverage(matched, Blocks((2, 4))), [0.5, 0.5])
    assert coverage(np.ones((3, 1)), Blocks((3,))) == [0.0]


def test_of_videos_that_show_as_much_the_steadiest_is_taken() -> None:
    covering, steady = np.array([0.95, 0.955, 0.95, 1.0]), np.array([0.5, 0.2, 0.22, 0.0])
    assert chosen_reference(CENTRAL, steady, covering, [True] * 4) == 1
    assert chosen_reference(CENTRAL[::-1], steady[::-1], covering[::-1], [True] * 4) == 2


def played(paces: list[np.ndarray]) -> PairMaps:
    """Maps between videos that go through one action at these seconds of it per frame."""
    times = [np.cumsum(pace) for pace in paces]
    positions = {
        (i, j): np.interp(a, b, np.arange(len(b)), left=np.nan, right=np.nan)
        for i, a in enumerate(times)
        for j, b in enumerate(times)
        if i != j
    }
    return PairMaps(positions, {pair: np.ones(len(p)) for pair, p in positions.items()})


def stalling(rng: np.random.Generator, frames: int) -> np.ndarray:
    """A third of the time the action stands still for a quarter of a second."""
    stalls = np.repeat(rng.random(frames // 8) < 0.33, 8)
    return np.where(stalls, 1e-4, 1.5) / 30


@pytest.mark.parametrize("rate", [1.0, 0.25])
def test_the_pace_that_varies_is_told_from_the_steady_one(rate: float) -> None:
    rng = np.random.default_rng(3)
    steady = np.full(round(150 / rate), rate / 30)
    paces = [stalling(rng, 160), steady, stalling(rng, 152), stalling(rng, 160)]
    clocks = Clocks([30.0] * 4, np.array([1.0, rate, 1.0, 1.0]))
    spreads = pace_spread(played(paces), [len(p) for p in paces], clocks)
    assert spreads.argmin() == 1
    assert spreads[1] < 0.15
    assert min(spreads[[0, 2, 3]]) > 0.35


def test_of_two_videos_neither_is_said_to_be_the_unsteady_one() -> None:
    paces = [stalling(np.random.default_rng(1), 160), np.full(150, 1 / 30)]
    first, second = pace_spread(played(paces), [160, 150], Clocks([30.0] * 2, np.ones(2)))
    assert first == second > 0.2


def test_videos_that_share_nothing_have_no_spread() -> None:
    apart = {pair: np.full(20, np.nan) for pair in ((0, 1), (1, 0))}
    maps = PairMaps(apart, {pair: np.zeros(20) for pair in apart})
    assert not pace_spread(maps, [20, 20], Clocks([30.0] * 2, np.ones(2))).any()
    assert not pace_spread(PairMaps({}, {}), [20], Clocks([30.0], np.ones(1))).any()
