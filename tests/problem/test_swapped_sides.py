"""Keypoints whose sides the other videos find swapped for a while are fitted as they should be."""

from __future__ import annotations

import numpy as np

from imocap_core.adapters.monocular import with_sides
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import mirror_indices
from imocap_core.motion.observations import Observation

FRAMES, FIRST, END, REACH = 20, 8, 15, 2
NAMES = layout_names("coco17")


def observation() -> Observation:
    rng = np.random.default_rng(4)
    return Observation(
        xy_px=rng.normal(200.0, 50.0, (FRAMES, len(NAMES), 2)),
        confidence=rng.uniform(0.3, 1.0, (FRAMES, len(NAMES))),
        K=np.diag([500.0, 500.0, 1.0]),
        fps=30.0,
        noise_share=0.01,
    )


def test_the_stretch_is_swapped_and_its_ends_count_nothing() -> None:
    given, states = observation(), np.zeros(FRAMES, dtype=int)
    states[FIRST:END] = 3  # above the hips and the legs
    swapped = with_sides(given, states, NAMES, REACH)
    twins = list(mirror_indices(NAMES))
    inside = np.arange(FIRST, END)
    np.testing.assert_array_equal(swapped.xy_px[inside], given.xy_px[inside][:, twins])
    np.testing.assert_array_equal(
        np.delete(swapped.xy_px, inside, 0), np.delete(given.xy_px, inside, 0)
    )
    near = [*range(FIRST - REACH, FIRST + REACH), *range(END - REACH, END + REACH)]
    assert (swapped.confidence[near] == 0).all()
    middle = slice(FIRST + REACH, END - REACH)
    np.testing.assert_array_equal(swapped.confidence[middle], given.confidence[middle][:, twins])


def test_nothing_swapped_changes_nothing() -> None:
    given = observation()
    same = with_sides(given, np.zeros(FRAMES, dtype=int), NAMES, REACH)
    np.testing.assert_array_equal(same.xy_px, given.xy_px)
    np.testing.assert_array_equal(same.confidence, given.confidence)
