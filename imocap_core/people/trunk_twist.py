"""Arms or legs alone with left and right swapped, told by the trunk's impossible twist.

A detector that takes a back for a front may swap the arms and keep the legs, or the reverse. Then
the shoulders lie in the picture the other way round than the hips, which no trunk can do while both
are wide. Each frame is as reported, or its arms or its legs are swapped; the cheapest sequence of
these states, by the twist and by how far the limbs' joints move from frame to frame, is the
estimate (Viterbi). Unlike a swap of all limbs, this one may last: nobody turns round like that. A
stretch in which the twist does not speak for it stays as reported: a limb that jumps once, as where
legs cross, would else be swapped from there to the end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.people.sides import change_costs, limbs_of, step_costs
from imocap_core.runs import runs
from imocap_core.viterbi import cheapest_states

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
    lines = [line_between(xy_px, names, part) for part in ("shoulder", "hip")]
    if len(xy_px) < 2 or any(line is None for line in lines):
        return none
    shoulders, hips = (line for line in lines if line is not None)
    twist = np.stack([least_twist_deg(s * shoulders, hips, size_px) for s in (1.0, -1.0)], axis=1)
    parity = np.array([(arms + legs) % 2 for arms, legs in STATES])
    excess_deg = np.maximum(twist[:, parity] - POSSIBLE_DEG, 0.0)
    unary = TWIST * excess_deg / (180.0 - POSSIBLE_DEG)
    steps = np.zeros((len(xy_px), len(STATES), len(STATES)))
    for limb, pairs in enumerate(limbs_of(names)[:2]):
        of_limb = [state[limb] for state in STATES]
        cost = step_costs(xy_px[:, np.array(pairs)], size_px) + change_costs(len(pairs))
        steps += cost[:, of_limb][:, :, of_limb]
    states = np.array(STATES)[cheapest_states(unary[0], steps[1:] + unary[1:, None])]
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


def line_between(
    xy_px: Float[np.ndarray, "T K 2"], names: Sequence[str], part: str
) -> Float[np.ndarray, "T 2"] | None:
    """From the right to the left joint of a part; None where a layout lacks one."""
    ends = [f"{side}_{part}" for side in ("left", "right")]
    if not set(ends) <= set(names):
        return None
    left, right = (xy_px[:, list(names).index(end)] for end in ends)
    line: np.ndarray = left - right
    return line


def least_twist_deg(
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
