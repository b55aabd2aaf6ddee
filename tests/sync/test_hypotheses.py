"""One hypothesis for each video: the joint choice is the least energy, and pictures decide it."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.sync.hypotheses import (
    CandidateMotions,
    Hypothesis3D,
    JointChoice,
    best_labellings,
    choose_jointly,
    energy_of,
    pair_costs,
    sentences,
    swapped_by_others,
    swapped_keypoints,
    with_swapped_sides,
)
from tests.sync.made_motions import filmed, view_of, wandering

DEPTH = np.array([1.0, 1.0, -1.0])


def random_energies(seed: int, sizes: list[int]) -> tuple[list, dict]:
    rng = np.random.default_rng(seed)
    unary = [rng.random(n) for n in sizes]
    pairs = {
        (u, v): rng.random((sizes[u], sizes[v]))
        for u in range(len(sizes))
        for v in range(u + 1, len(sizes))
    }
    return unary, pairs


@pytest.mark.parametrize("seed", range(5))
def test_branch_and_bound_finds_what_enumeration_finds(seed: int) -> None:
    unary, pairs = random_energies(seed, [3, 1, 4, 2, 3])
    every = {x: energy_of(x, unary, pairs) for x in product(*map(range, (3, 1, 4, 2, 3)))}
    near = best_labellings(unary, pairs, margin=0.2)
    least = min(every.values())
    assert near[0].energy == pytest.approx(least)
    assert {x.labels for x in near} == {x for x, e in every.items() if e <= least + 0.2}


def test_twelve_videos_are_searched() -> None:
    unary, pairs = random_energies(1, [4] * 12)
    for (u, v), cost in pairs.items():  # one consistent choice among noise
        cost[u % 4, v % 4] -= 0.5
    assert best_labellings(unary, pairs, margin=0.0)[0].labels == tuple(v % 4 for v in range(12))


def test_reversed_depth_does_not_agree_with_a_right_motion() -> None:
    a, b = view_of(wandering(3, 12, 45), 0.3), view_of(wandering(3, 12, 45), 1.5)
    of_a, of_b = (
        [Hypothesis3D(x, filmed(right)) for x in (right, right * DEPTH)] for right in (a, b)
    )
    costs = pair_costs(of_a, of_b)
    assert costs[0, 0] < 0.6 * min(costs[0, 1], costs[1, 0])
    # both reversed are the mirror image of the scene, as good to cameras without perspective
    assert costs[1, 1] == pytest.approx(costs[0, 0], rel=0.2)


def candidates(wrong: tuple[int, ...], excess: float) -> list[CandidateMotions]:
    """Four videos of one motion; those in `wrong` have its reversed depth as the likeliest."""
    videos = []
    for v, azimuth in enumerate((0.0, 0.9, 2.0, 4.2)):
        right = view_of(wandering(7, 12, 45), azimuth)
        motions = [right, right * DEPTH]
        ordered = motions[::-1] if v in wrong else motions
        film = filmed(right)
        hypotheses = [Hypothesis3D(x, film) for x in ordered]
        videos.append(CandidateMotions(hypotheses, np.array([0.0, excess]), 15.0))
    return videos


@pytest.mark.parametrize("wrong", [(), (0,), (2,)])
def test_wrongly_started_videos_are_put_right(wrong: tuple[int, ...]) -> None:
    choice = choose_jointly(candidates(wrong, 5.0))
    assert choice.labels == tuple(int(v in wrong) for v in range(4))
    assert choice.rivals == [(), (), (), ()]


def test_two_of_four_reversed_are_a_tie_without_perspective_or_a_body() -> None:
    choice = choose_jointly(candidates((0, 3), 5.0))
    assert choice.labels in {(1, 0, 0, 1), (0, 1, 1, 0)}
    assert choice.rivals == [(1 - label,) for label in choice.labels]


def test_single_motions_leave_nothing_to_choose() -> None:
    films = candidates((), 5.0)
    one = [CandidateMotions(v.hypotheses[:1], v.excess[:1], v.fps) for v in films]
    assert choose_jointly(one) == JointChoice((0, 0, 0, 0), [(), (), (), ()])


def test_a_change_and_a_tie_are_said() -> None:
    choice = JointChoice((1, 0), [(), (1,)])
    changed, tie = sentences(choice, ["left", "right"], [["best", "depth"], ["best", "start 2"]])
    assert changed.startswith("left")
    assert "depth reversed" in changed
    assert tie.startswith("right")
    assert "do not decide" in tie
    alike = [["best", "swapped", "swapped, depth"], ["best"]]
    assert len(sentences(JointChoice((1, 0), [(2,), ()]), ["left", "right"], alike)) == 1


def test_a_motion_that_the_other_videos_suggested_costs_nothing_to_take() -> None:
    films = candidates((), 0.0)
    same = replace(films[1], hypotheses=[films[1].hypotheses[0]] * 2)
    assert choose_jointly([films[0], same, *films[2:]]).labels[1] == 0
    better = replace(same, excess=np.array([0.0, -9.0]), suggested=np.array([False, True]))
    assert choose_jointly([films[0], better, *films[2:]]).labels[1] == 1


FRAMES = 45
PERFORMANCE = wandering(5, 24, FRAMES)


def videos(states: np.ndarray, count: int = 4) -> list[CandidateMotions]:
    """Views of one performance; in the second the detector swaps sides."""
    out = []
    for v, azimuth in enumerate((0.0, 0.9, 2.0, 4.2)[:count]):
        motion = view_of(PERFORMANCE, azimuth)
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
