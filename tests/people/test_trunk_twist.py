"""Arms or legs swapped alone are put back, however long it lasts; possible poses stay."""

import numpy as np
import pytest

from imocap_core.body.layouts import layout_names
from imocap_core.people.left_right import limbs_of, swapped_arms_and_legs

NAMES = layout_names("coco17")
ARMS, LEGS = limbs_of(NAMES)[:2]
FRAMES = 90
SIZE = np.full(FRAMES, 300.0)
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


def swapped(xy: np.ndarray, limb: list[tuple[int, int]], first: int, last: int) -> np.ndarray:
    out = xy.copy()
    for left, right in limb:
        out[first : last + 1, [left, right]] = xy[first : last + 1, [right, left]]
    return out


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
