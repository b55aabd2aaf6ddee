"""The reference: central, and showing as much of the others as that allows, in any order."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.reference import central_and_covering, coverage

CENTRAL, COVERING = np.array([0.52, 0.50, 0.45, 0.20]), np.array([0.90, 0.98, 0.95, 1.0])


def test_it_shows_most_among_the_central_videos_in_any_order() -> None:
    for order in permutations(range(4)):
        rows = list(order)
        assert rows[central_and_covering(CENTRAL[rows], COVERING[rows], [True] * 4)] == 1


@pytest.mark.parametrize("seed", range(5))
def test_small_changes_of_centrality_do_not_move_it(seed: int) -> None:
    change = np.random.default_rng(seed).uniform(-0.04, 0.04, 4)
    assert central_and_covering(CENTRAL + change, COVERING, [True] * 4) == 1


def test_the_most_central_of_videos_that_show_as_much_is_taken() -> None:
    assert central_and_covering(CENTRAL, np.full(4, 0.95), [True] * 4) == 0


def test_only_eligible_videos_are_taken_unless_none_is() -> None:
    assert central_and_covering(CENTRAL, COVERING, [True, False, True, True]) == 2
    assert central_and_covering(CENTRAL, COVERING, [False] * 4) == 1


def test_coverage_is_the_mean_share_of_each_other_videos_frames() -> None:
    matched = np.array([[1.0, 0.5], [1.0, 0.5], [0.25, 1.0], [0.75, 1.0], [0.5, 1.0], [0.5, 1.0]])
    np.testing.assert_allclose(coverage(matched, Blocks((2, 4))), [0.5, 0.5])
    assert coverage(np.ones((3, 1)), Blocks((3,))) == [0.0]
