"""Points that lie on the picture move with it; others do not."""

from __future__ import annotations

import numpy as np

from imocap_core.people.shot_boundaries import Agreement

RNG = np.random.default_rng(0)
SCENE = RNG.integers(0, 255, (60, 80), dtype=np.uint8).repeat(4, 0).repeat(4, 1)
POINTS = RNG.uniform((60, 60), (240, 180), (30, 2))


def test_points_that_move_with_the_picture_those_that_do_not_and_still_ones() -> None:
    agreement = Agreement(4)
    for dx, dy in ((3, 0), (-2, 4), (0, -5)):
        after = np.roll(SCENE, (dy, dx), axis=(0, 1))
        moved, across = POINTS + (dx, dy), POINTS + (dy, -dx)
        nobody = np.zeros((0, 2))
        rows = [(POINTS, moved), (POINTS, across), (POINTS, POINTS), (nobody, nobody)]
        agreement.add(SCENE, after, rows)
    right, wrong, still, none = agreement.values()
    assert right > 0.95
    assert abs(wrong) < 0.1
    assert np.isnan(still)
    assert np.isnan(none)


def test_points_outside_the_picture_agree_with_nothing() -> None:
    agreement = Agreement(1)
    agreement.add(SCENE, np.roll(SCENE, 3, axis=1), [(POINTS + 1000.0, POINTS + (1003.0, 1000.0))])
    assert agreement.values() == [0.0]
