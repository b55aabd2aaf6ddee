"""Left-right swaps of a detector, found and repaired by dynamic programming over time (Viterbi).

Per limb (arms, legs, face) each frame is either as reported or swapped. The cheapest sequence of
these states, by how far the limb's joints move from frame to frame, is the estimate; a change of
state costs something, and so does every swapped frame, so that correct frames stay as they are.

Arms or legs alone: a detector that takes a back for a front may swap the arms and keep the legs, or
the reverse. Then the shoulders lie the other way round than the hips, an impossible twist of the
trunk while both are wide, which counts too. Such a swap may last; a stretch in which the twist does
not speak for it stays as reported (a limb that jumps once, as where legs cross).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.conventions import left_right_pairs
from imocap_core.sequences import runs, viterbi

POSSIBLE_DEG = 120.0  # a trunk's twist that costs nothing
TWIST = 0.2  # cost of a frame with shoulders and hips exactly opposite
WIDEST = 0.9  # quantile of a line's length in the picture that counts as its full length
LEAST_TWIST = 0.1  # in a swapped stretch, its frames' cost as reported beyond that as swapped
BREADTHS = (0.18, 0.09)  # of shoulders and hips at least, in the person's size
STATES = ((0, 0), (1, 0), (0, 1))  # arms swapped, legs swapped


def swapped_arms_and_legs(
    xy_px: Float[np.ndarray, "T K 2"], size_px: Float[np.ndarray, " T"], names: Sequence[str]
) -> Bool[np.ndarray, "2 T"]:
    """In which frames the arms alone, and the legs alone, are swapped.

    Args:
        xy_px: keypoints, NaN where missing. size_px: of the person.
        names: of the keypoints; a layout without shoulders or hips has no such frames.
    """
    none = np.zeros((2, len(xy_px)), dtype=bool)
    lines = [_line_between(xy_px, names, part) for part in ("shoulder", "hip")]
    if len(xy_px) < 2 or any(line is None for line in lines):
        return none
    shoulders, hips = (line for line in lines if line is not None)
    twist = np.stack([_least_twist_deg(s * shoulders, hips, size_px) for s in (1.0, -1.0)], axis=1)
    parity = np.array([(arms + legs) % 2 for arms, legs in STATES])
    excess_deg = np.maximum(twist[:, parity] - POSSIBLE_DEG, 0.0)
    unary = TWIST * excess_deg / (180.0 - POSSIBLE_DEG)
    steps = np.zeros((len(xy_px), len(STATES), len(STATES)))
    for limb, pairs in enumerate(limbs_of(names)[:2]):
        of_limb = [state[limb] for state in STATES]
        cost = _step_costs(xy_px[:, np.array(pairs)], size_px) + _change_costs(len(pairs))
        steps += cost[:, of_limb][:, :, of_limb]
    states = np.array(STATES)[viterbi(unary[0], steps[1:] + unary[1:, None])]
    gain = unary[:, 0] - unary[:, 1]
    return np.stack([_twisted(states[:, limb] == 1, gain) for limb in (0, 1)])


def _twisted(
    swapped: Bool[np.ndarray, " T"], gain: Float[np.ndarray, " T"]
) -> Bool[np.ndarray, " T"]:
    """Of the swapped frames, the stretches that the twist speaks for; gain: what each saves."""
    twisted = np.zeros_like(swapped)
    for first, last in runs(swapped):
        stretch = slice(first, last + 1)
        twisted[stretch] = gain[stretch].sum() >= LEAST_TWIST
    return twisted


def _line_between(
    xy_px: Float[np.ndarray, "T K 2"], names: Sequence[str], part: str
) -> Float[np.ndarray, "T 2"] | None:
    """From the right to the left joint of a part; None where a layout lacks one."""
    ends = [f"{side}_{part}" for side in ("left", "right")]
    if not set(ends) <= set(names):
        return None
    left, right = (xy_px[:, list(names).index(end)] for end in ends)
    line: np.ndarray = left - right
    return line


def _least_twist_deg(
    shoulders: Float[np.ndarray, "T 2"],
    hips: Float[np.ndarray, "T 2"],
    size_px: Float[np.ndarray, " T"],
) -> Float[np.ndarray, " T"]:
    """The smallest twist between shoulders and hips that their lines in the picture allow.

    A line's foreshortening tells its angle to the picture, but for its sign. 0 where both point the
    same way, where one is missing, and where no line is long enough to tell.
    """
    lines = zip((shoulders, hips), BREADTHS, strict=True)
    angles = [_foreshortening_deg(line / size_px[:, None], breadth) for line, breadth in lines]
    opposite = (shoulders * hips).sum(-1) < 0
    twist = np.where(opposite, 180.0 - angles[0] - angles[1], 0.0)
    return np.nan_to_num(np.maximum(twist, 0.0))


def _foreshortening_deg(line: Float[np.ndarray, "T 2"], breadth: float) -> Float[np.ndarray, " T"]:
    """Angle of a line to the picture, 0 to 90 degrees; NaN where it is missing."""
    length = np.linalg.norm(line, axis=-1)
    if not np.isfinite(length).any():
        return np.full(len(length), np.nan)
    share: np.ndarray = length / max(float(np.nanquantile(length, WIDEST)), breadth)
    return np.degrees(np.arccos(np.clip(share, 0.0, 1.0)))


LIMB_CHAINS: tuple[tuple[str, ...], ...] = (
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
    limbs = [
        [p for p in pairs if names[p[0]].removeprefix("left_") in parts] for parts in LIMB_CHAINS
    ]
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
    states = _states(_step_costs(sides, size_px), len(pairs))
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


def _step_costs(
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
    costs = steps[1:] + _change_costs(pairs)
    return viterbi(np.array([0.0, np.inf]), costs).astype(bool)


def _change_costs(pairs: int) -> Float[np.ndarray, "2 2"]:
    """Cost of a change of state, and of the swapped state, for a limb of some joint pairs."""
    return CHANGE * pairs * (1.0 - np.eye(2)) + np.array([0.0, SWAPPED * pairs])
