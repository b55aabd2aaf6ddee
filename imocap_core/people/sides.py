"""Left and right exchanged by a detector for a moment: found by what it does to the motion.

Per limb (arms, legs, face) each frame is either as reported or exchanged. The cheapest course over
time, by how far the limb's joints move from frame to frame, tells which; changing over costs
something, and so does every exchanged frame, so that nothing is touched without a reason.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imocap_core.conventions import left_right_pairs

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

LIMBS: tuple[tuple[str, ...], ...] = (
    ("shoulder", "elbow", "wrist"),
    ("hip", "knee", "ankle", "heel", "big_toe", "small_toe", "foot_index"),
    ("eye", "ear", "eye_inner", "eye_outer", "mouth"),
)
CHANGE = 0.12  # of the person's size, a joint pair: what changing over costs
EXCHANGED = 0.002  # the same, for each frame that is exchanged
CAP = 0.5  # a joint that leaps further is a wrong detection, not a side
LONGEST_S = 1.0  # what lasts longer may be a person who turned round


def limbs_of(names: Sequence[str]) -> list[list[tuple[int, int]]]:
    """Column pairs (left, right) of each limb that a layout has."""
    pairs = left_right_pairs(names)
    found = [[p for p in pairs if names[p[0]].removeprefix("left_") in parts] for parts in LIMBS]
    return [pairs_of_limb for pairs_of_limb in found if pairs_of_limb]


def exchanged(xy_px: Array, size_px: Array, pairs: Sequence[tuple[int, int]], fps: float) -> Bools:
    """(T,) frames in which a limb's left and right are exchanged.

    Args:
        xy_px: (T, K, 2), NaN where missing; size_px: (T,) of the person; pairs: of the limb.
    """
    sides = xy_px[:, np.array(pairs)]  # (T, P, 2 sides, 2)
    steps = _steps(sides, size_px)
    course = _cheapest(steps, len(pairs))
    longest = round(LONGEST_S * fps)
    kept: Bools = np.zeros(len(course), dtype=bool)
    for begin, end in bouts(course):
        kept[begin:end] = end - begin <= longest and begin > 0 and end < len(course)
    return kept


def repaired(xy_px: Array, confidence: Array, frames: Bools, pairs: Sequence[tuple[int, int]]) \
        -> tuple[Array, Array]:  # fmt: skip
    """Keypoints (T, K, 2) and confidences (T, K) with a limb's sides put back in some frames."""
    xy, trust = xy_px.copy(), confidence.copy()
    for left, right in pairs:
        xy[frames, left], xy[frames, right] = xy_px[frames, right], xy_px[frames, left]
        trust[frames, left], trust[frames, right] = (
            confidence[frames, right],
            confidence[frames, left],
        )
    return xy, trust


def bouts(flags: Bools) -> list[tuple[int, int]]:
    """First and one past the last frame of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _steps(sides: Array, size_px: Array) -> Array:
    """(T, 2, 2) cost of frame t as (reported, exchanged) after t - 1 as (reported, exchanged).

    Distances in sizes of the person, summed over the joints that both frames have (missing ones
    stand where they were last seen, for as long as that costs no more than `CAP`).
    """
    filled = _last_seen(sides)
    cost = np.zeros((len(sides), 2, 2))
    for now in (0, 1):
        own = sides[1:] if now == 0 else sides[1:, :, ::-1]
        for before in (0, 1):
            last = filled[:-1] if before == 0 else filled[:-1, :, ::-1]
            away = np.linalg.norm(own - last, axis=-1) / size_px[1:, None, None]
            cost[1:, before, now] = np.nan_to_num(np.minimum(away, CAP)).sum((1, 2))
    return cost


def _last_seen(sides: Array) -> Array:
    """The last known place of every joint, in the sides as reported."""
    filled = sides.copy()
    for t in range(1, len(filled)):
        filled[t] = np.where(np.isfinite(filled[t]), filled[t], filled[t - 1])
    return filled


def _cheapest(steps: Array, pairs: int) -> Bools:
    """Which frames are exchanged on the cheapest course; it begins as reported."""
    change = CHANGE * pairs * (1.0 - np.eye(2))
    total, back = np.array([0.0, np.inf]), []
    for step in steps[1:]:
        ways = total[:, None] + step + change
        back.append(ways.argmin(0))
        total = ways.min(0) + np.array([0.0, EXCHANGED * pairs])
    state, course = int(total.argmin()), []
    for pointer in reversed(back):
        course.append(state)
        state = int(pointer[state])
    return np.array([state, *reversed(course)], dtype=bool)
