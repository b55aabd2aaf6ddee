"""Left-right swaps of a detector, found and repaired by dynamic programming over time (Viterbi).

Per limb (arms, legs, face) each frame is either as reported or swapped. The cheapest sequence of
these states, by how far the limb's joints move from frame to frame, is the estimate; a change of
state costs something, and so does every swapped frame, so that correct frames stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.conventions import left_right_pairs
from imocap_core.runs import runs
from imocap_core.viterbi import cheapest_states

LIMBS: tuple[tuple[str, ...], ...] = (
    ("shoulder", "elbow", "wrist"),
    ("hip", "knee", "ankle", "heel", "big_toe", "small_toe", "foot_index"),
    ("eye", "ear", "eye_inner", "eye_outer", "mouth"),
)
CHANGE = 0.12  # cost of a change of state, in units of the person's size per joint pair
SWAPPED = 0.002  # the same, of each swapped frame
CAP = 0.5  # a joint that jumps further is a false detection, not a swap
LONGEST_S = 1.0  # a longer swap may be a person who turned round
NEAR_S = 0.2  # swaps less than so far apart are one choice


def limbs_of(names: Sequence[str]) -> list[list[tuple[int, int]]]:
    """Column pairs (left, right) of each limb that a layout has."""
    pairs = left_right_pairs(names)
    limbs = [[p for p in pairs if names[p[0]].removeprefix("left_") in parts] for parts in LIMBS]
    return [limb for limb in limbs if limb]


def swapped_frames(
    xy_px: Float[np.ndarray, "T K 2"],
    size_px: Float[np.ndarray, " T"],
    pairs: Sequence[tuple[int, int]],
    fps: float,
) -> Bool[np.ndarray, " T"]:
    """Whether a limb's left and right are swapped in each frame.

    A swap that lasts too long, or to the end, may be a person who turned round, and stays as
    reported; so do swaps close to it, which were chosen together with it.

    Args:
        xy_px: keypoints, NaN where missing. size_px: of the person.
        pairs: columns (left, right) of the limb.
    """
    sides = xy_px[:, np.array(pairs)]  # (T, P, 2 sides, 2)
    states = _states(step_costs(sides, size_px), len(pairs))
    longest, near = round(LONGEST_S * fps), max(0, round(NEAR_S * fps) - 1)
    for first, last in runs(states, gap=near):
        lasts = any(b - a >= longest for a, b in runs(states[first : last + 1]))
        if lasts or last == len(states) - 1:
            states[first : last + 1] = False
    return states


def swap_sides(
    xy_px: Float[np.ndarray, "T K 2"],
    confidence: Float[np.ndarray, "T K"],
    frames: Bool[np.ndarray, " T"],
    pairs: Sequence[tuple[int, int]],
) -> tuple[Float[np.ndarray, "T K 2"], Float[np.ndarray, "T K"]]:
    """Keypoints and confidences with a limb's left and right swapped in some frames."""
    xy, trust = xy_px.copy(), confidence.copy()
    for left, right in pairs:
        xy[frames, left], xy[frames, right] = xy_px[frames, right], xy_px[frames, left]
        trust[frames, left], trust[frames, right] = (
            confidence[frames, right],
            confidence[frames, left],
        )
    return xy, trust


def step_costs(
    sides: Float[np.ndarray, "T P 2 2"], size_px: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T 2 2"]:
    """Cost of frame t in state (reported, swapped) after frame t - 1 in (reported, swapped).

    Distances in units of the person's size, at most `CAP` each, summed over the joints; a joint
    missing in the frame before is compared with its last detected position.
    """
    filled = _forward_filled(sides)
    cost = np.zeros((len(sides), 2, 2))
    for now in (0, 1):
        current = sides[1:] if now == 0 else sides[1:, :, ::-1]
        for before in (0, 1):
            last = filled[:-1] if before == 0 else filled[:-1, :, ::-1]
            distance = np.linalg.norm(current - last, axis=-1) / size_px[1:, None, None]
            cost[1:, before, now] = np.nan_to_num(np.minimum(distance, CAP)).sum((1, 2))
    return cost


def _forward_filled(sides: Float[np.ndarray, "T P 2 2"]) -> Float[np.ndarray, "T P 2 2"]:
    """The last detected position of every joint, in the sides as reported."""
    filled = sides.copy()
    for t in range(1, len(filled)):
        filled[t] = np.where(np.isfinite(filled[t]), filled[t], filled[t - 1])
    return filled


def _states(steps: Float[np.ndarray, "T 2 2"], pairs: int) -> Bool[np.ndarray, " T"]:
    """Which frames are swapped in the cheapest sequence; it begins as reported."""
    costs = steps[1:] + change_costs(pairs)
    return cheapest_states(np.array([0.0, np.inf]), costs).astype(bool)


def change_costs(pairs: int) -> Float[np.ndarray, "2 2"]:
    """Cost of a change of state, and of the swapped state, for a limb of some joint pairs."""
    return CHANGE * pairs * (1.0 - np.eye(2)) + np.array([0.0, SWAPPED * pairs])
