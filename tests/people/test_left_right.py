"""Swapped sides are put back; what is as it should be is not touched."""

import numpy as np
import pytest

from imocap_core.body.layouts import layout_names
from imocap_core.people.left_right import (
    limbs_of,
    swap_sides,
    swapped_arms_and_legs,
    swapped_frames,
)
from imocap_core.sequences import runs

NAMES = layout_names("coco17")
FPS = 30.0
LEGS = next(pairs for pairs in limbs_of(NAMES) if NAMES[pairs[0][0]] == "left_hip")


def walker(frames: int = 90, noise_px: float = 1.0, seed: int = 0) -> np.ndarray:
    """Points (T, 17, 2) of somebody 300 px tall whose sides pass each other as in a walk."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames) / FPS
    xy = np.zeros((frames, 17, 2))
    for k, name in enumerate(NAMES):
        sign = {"left": 1.0, "right": -1.0}.get(name.split("_")[0], 0.0)
        xy[:, k, 0] = 100 * time + sign * 40 * np.sin(2 * np.pi * time) + 8 * sign
        xy[:, k, 1] = 17.0 * k
    return xy + rng.normal(0, noise_px, xy.shape)


def swapped(xy: np.ndarray, limb: list[tuple[int, int]], first: int, last: int) -> np.ndarray:
    out = xy.copy()
    for left, right in limb:
        out[first : last + 1, [left, right]] = xy[first : last + 1, [right, left]]
    return out


def with_swapped(xy: np.ndarray, begin: int, end: int) -> np.ndarray:
    return swapped(xy, LEGS, begin, end - 1)


SIZE = np.full(90, 300.0)


@pytest.mark.parametrize("span", [(34, 37), (50, 51), (63, 72)])
def test_a_bout_is_found_and_undone(span: tuple[int, int]) -> None:
    xy = walker()
    swapped = with_swapped(xy, *span)
    frames = swapped_frames(swapped, SIZE, LEGS, FPS)
    assert runs(frames) == [(span[0], span[1] - 1)]
    trust = np.random.default_rng(1).random(xy.shape[:2])
    again, _ = swap_sides(swapped, trust, frames, LEGS)
    np.testing.assert_array_equal(again, xy)
    twice = swap_sides(*swap_sides(swapped, trust, frames, LEGS), frames, LEGS)
    np.testing.assert_array_equal(twice[0], swapped)
    np.testing.assert_array_equal(twice[1], trust)


@pytest.mark.parametrize("noise_px", [0.0, 3.0])
def test_nothing_is_touched_where_nothing_is_wrong(noise_px: float) -> None:
    assert not swapped_frames(walker(noise_px=noise_px), SIZE, LEGS, FPS).any()


def test_a_bout_is_the_same_bout_backwards() -> None:
    swapped = with_swapped(walker(), 40, 45)
    forwards = swapped_frames(swapped, SIZE, LEGS, FPS)
    backwards = swapped_frames(swapped[::-1], SIZE, LEGS, FPS)[::-1]
    np.testing.assert_array_equal(forwards, backwards)


def test_who_turns_round_for_good_is_left_alone() -> None:
    assert not swapped_frames(with_swapped(walker(), 40, 90), SIZE, LEGS, FPS).any()
    assert not swapped_frames(with_swapped(walker(), 20, 70), SIZE, LEGS, FPS).any()


def test_a_bout_beside_a_turn_is_left_alone_and_one_far_from_it_undone() -> None:
    """The cheapest sequence has both; the near bout was chosen together with the turn."""
    turned = with_swapped(walker(), 36, 90)
    near = swapped_frames(with_swapped(turned, 25, 33), SIZE, LEGS, FPS)
    assert not near.any()
    far = swapped_frames(with_swapped(turned, 8, 12), SIZE, LEGS, FPS)
    assert runs(far) == [(8, 11)]


def test_missing_points_do_not_hide_a_bout() -> None:
    swapped = with_swapped(walker(), 34, 38)
    swapped[33:36, LEGS[0][0]] = np.nan
    swapped[36, LEGS[1][1]] = np.nan
    assert runs(swapped_frames(swapped, SIZE, LEGS, FPS)) == [(34, 37)]


def test_limbs_of_layouts() -> None:
    assert [len(pairs) for pairs in limbs_of(NAMES)] == [3, 3, 2]
    assert [len(pairs) for pairs in limbs_of(layout_names("body25"))] == [3, 6, 2]


ARMS = limbs_of(NAMES)[0]
FRAMES = 90
HALF_WIDTH_PX = {
    **{"shoulder": 30.0, "elbow": 38.0, "wrist": 42.0},
    **{"hip": 20.0, "knee": 22.0, "ankle": 20.0},
}


def dancer(twist_deg: float = 0.0, turn_deg: float = 0.0, noise_px: float = 1.0) -> np.ndarray:
    """Points (T, 17, 2) of somebody 300 px tall who sways; the shoulders are turned by a twist."""
    rng = np.random.default_rng(3)
    xy = np.zeros((FRAMES, len(NAMES), 2))
    sway = 20.0 * np.sin(np.arange(FRAMES) / 9.0)
    for k, name in enumerate(NAMES):
        side, _, part = name.partition("_")
        sign = {"left": 1.0, "right": -1.0}.get(side, 0.0)
        angle = turn_deg + (twist_deg if part in ("shoulder", "elbow", "wrist") else 0.0)
        xy[:, k, 0] = sway + sign * HALF_WIDTH_PX.get(part, 5.0) * np.cos(np.deg2rad(angle))
        xy[:, k, 1] = 17.0 * k
    return xy + rng.normal(0, noise_px, xy.shape)


@pytest.mark.parametrize("limb", [0, 1])
@pytest.mark.parametrize("span", [(20, 22), (10, 75), (0, 39)])
def test_a_limb_swapped_alone_is_told(limb: int, span: tuple[int, int]) -> None:
    given = swapped(dancer(), (ARMS, LEGS)[limb], *span)
    frames = swapped_arms_and_legs(given, SIZE, NAMES)
    expected = np.zeros((2, FRAMES), dtype=bool)
    expected[limb, span[0] : span[1] + 1] = True
    np.testing.assert_array_equal(frames, expected)


@pytest.mark.parametrize("twist_deg", [0.0, 45.0, -80.0])
@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 150.0])
def test_what_a_trunk_can_do_stays(twist_deg: float, turn_deg: float) -> None:
    assert not swapped_arms_and_legs(dancer(twist_deg, turn_deg), SIZE, NAMES).any()


def test_a_swap_of_all_limbs_is_not_judged() -> None:
    both = swapped(swapped(dancer(), ARMS, 30, 60), LEGS, 30, 60)
    assert not swapped_arms_and_legs(both, SIZE, NAMES).any()


def test_noise_in_a_side_view_swaps_nothing() -> None:
    assert not swapped_arms_and_legs(dancer(turn_deg=90.0, noise_px=4.0), SIZE, NAMES).any()


def test_legs_that_jump_past_each_other_are_not_swapped_from_there_on() -> None:
    """Seen from the side the trunk tells nothing, and the legs' jump alone is no reason."""
    given = dancer(turn_deg=90.0)
    for left, right in LEGS[1:]:
        apart = np.where(np.arange(FRAMES) < FRAMES // 2, 40.0, -40.0)
        given[:, left, 0] += apart
        given[:, right, 0] -= apart
    assert not swapped_arms_and_legs(given, SIZE, NAMES).any()


def test_missing_joints_and_layouts_without_a_trunk() -> None:
    given = swapped(dancer(), ARMS, 30, 60)
    given[40:44, ARMS[0][0]] = np.nan
    frames = swapped_arms_and_legs(given, SIZE, NAMES)
    np.testing.assert_array_equal(np.flatnonzero(frames[0]), np.arange(30, 61))
    legless = [n for n in NAMES if "hip" not in n]
    columns = [NAMES.index(n) for n in legless]
    assert not swapped_arms_and_legs(given[:, columns], SIZE, legless).any()
