"""Sides that a detector swapped for a while are told by the other videos, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.sync.hypotheses import (
    CandidateMotions,
    Hypothesis3D,
    swapped_by_others,
    swapped_keypoints,
    with_swapped_sides,
)
from tests.sync.test_hypotheses import filmed, view_of

FRAMES = 45


def performance() -> np.ndarray:
    """Joints (T, 24, 3) that wander smoothly, without any symmetry."""
    rng = np.random.default_rng(5)
    start, first, second = rng.normal(size=(3, 24, 3))
    t = np.linspace(0.0, 1.0, FRAMES)[:, None, None]
    return start + first * np.sin(4 * t) + second * np.cos(5 * t)


def videos(states: np.ndarray, count: int = 4) -> list[CandidateMotions]:
    """Views of one performance; in the second the detector swaps sides."""
    out = []
    for v, azimuth in enumerate((0.0, 0.9, 2.0, 4.2)[:count]):
        motion = view_of(performance(), azimuth)
        film = filmed(motion)
        if v == 1:
            film = swapped_keypoints(film, states, SMPL_JOINTS)
        out.append(CandidateMotions([Hypothesis3D(motion, film)], np.zeros(1), 15.0))
    return out


@pytest.mark.parametrize("state", [1, 2, 3])
def test_an_swap_is_told_where_it_is_and_what_it_is(state: int) -> None:
    true = np.zeros(FRAMES, dtype=int)
    true[12:30] = state
    estimates = swapped_by_others(videos(true), SMPL_JOINTS)
    assert (estimates[1] == true).mean() > 0.9
    assert not any(estimates[v].any() for v in (0, 2, 3))


def test_nothing_is_swapped_undisturbed_throughout_or_by_one_other() -> None:
    none, every = np.zeros(FRAMES, dtype=int), np.full(FRAMES, 3)
    some = np.where(np.arange(FRAMES) < 15, 3, 0)
    for films in (videos(none), videos(every), videos(some, count=2)):
        assert not any(states.any() for states in swapped_by_others(films, SMPL_JOINTS))


def test_swapping_twice_changes_nothing_and_parts_make_the_whole() -> None:
    values = np.random.default_rng(0).normal(size=(FRAMES, 24, 2))
    states = np.arange(FRAMES) % 4
    once = with_swapped_sides(values, states, SMPL_JOINTS)
    np.testing.assert_array_equal(with_swapped_sides(once, states, SMPL_JOINTS), values)
    upper, legs, both = (
        lambda x, k=k: with_swapped_sides(x, np.full(FRAMES, k), SMPL_JOINTS) for k in (1, 2, 3)
    )
    np.testing.assert_array_equal(legs(upper(values)), both(values))
    left = SMPL_JOINTS.index("left_knee")
    np.testing.assert_array_equal(upper(values)[:, left], values[:, left])
