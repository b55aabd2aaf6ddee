"""Frames in which a detector took left for right, told by the other videos before any is solved.

One view cannot tell sides that are swapped for a while from a performer who faces the other way,
and a fit to them is wrong in every frame. Held against another video's motion (`registration`),
each frame's keypoints are as detected, or swapped above the hips, in the legs, or in both,
whichever that explains best, and the cheapest sequence of these states is the estimate (Viterbi).
Sides that seem swapped for most of a video are left: that is what a mirrored one looks like.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, Shaped

from imocap_core.conventions import mirror_indices
from imocap_core.sync.hypotheses.joint_choice import CandidateMotions, strides
from imocap_core.sync.screening.registration import (
    Keypoints2D,
    camera_directions,
    pose_residuals,
    warp_costs,
    warp_path,
)
from imocap_core.viterbi import cheapest_states

DIRECTIONS = 96
STATES = 4
LEGS = ("hip", "knee", "ankle", "foot", "toe", "heel")  # parts of their keypoints' names
SWAPPED, CHANGE = 0.1, 0.5  # of a frame, of a change of state, in shares of the spread
LEAST_GAIN = 0.05  # mean of all frames, from which the sides are taken to be swapped
LARGEST_SHARE = 0.5  # of a video's frames
CLOSEST = 2  # other videos that are asked: those whose motions explain the keypoints best


def swapped_by_others(
    videos: Sequence[CandidateMotions], names: Sequence[str]
) -> list[Int[np.ndarray, " _"]]:
    """Per video, the state of each frame by the other videos' first motions: what is swapped.

    0 nothing, 1 all above the hips, 2 the legs, 3 both. Nothing of fewer than three videos: one
    other may be the one that is wrong.

    Args:
        names: of the joints.
    """
    steps = strides(videos)
    thin = [v.hypotheses[0].every(n) for v, n in zip(videos, steps, strict=True)]
    out = []
    for v, (film, n) in enumerate(zip(thin, steps, strict=True)):
        others = [x.motion for u, x in enumerate(thin) if u != v]
        states = np.zeros(len(film.motion), dtype=int)
        if len(others) >= CLOSEST:
            states = _swapped(film.keypoints, others, names)
        out.append(np.repeat(states, n)[: len(videos[v].hypotheses[0].motion)])
    return out


def with_swapped_sides(
    values: Shaped[np.ndarray, "T K *rest"], states: Int[np.ndarray, " T"], names: Sequence[str]
) -> Shaped[np.ndarray, "T K *rest"]:
    """Values of keypoints with left and right swapped as the states of `swapped_by_others`
    say; names: of the keypoints."""
    out, twins = values.copy(), np.array(mirror_indices(names))
    legs = np.array([any(word in name for word in LEGS) for name in names])
    for bit, columns in ((1, np.flatnonzero(~legs)), (2, np.flatnonzero(legs))):
        frames = np.flatnonzero(states & bit)
        out[np.ix_(frames, columns)] = values[np.ix_(frames, twins[columns])]
    return out


def swapped_keypoints(
    keypoints: Keypoints2D, states: Int[np.ndarray, " T"], names: Sequence[str]
) -> Keypoints2D:
    """`with_swapped_sides` of keypoints."""
    xy_px, weight = (
        with_swapped_sides(x, states, names) for x in (keypoints.xy_px, keypoints.weight)
    )
    return Keypoints2D(xy_px, weight)


def _swapped(
    keypoints: Keypoints2D, others: Sequence[Float[np.ndarray, "_ J 3"]], names: Sequence[str]
) -> Int[np.ndarray, " T"]:
    frames = len(keypoints.weight)
    films = [swapped_keypoints(keypoints, np.full(frames, k), names) for k in range(STATES)]
    rows = sorted((_residuals(x, films) for x in others), key=lambda row: row[0])
    residuals = np.mean([row[1] for row in rows[:CLOSEST]], axis=0)
    costs = residuals + SWAPPED * (np.arange(STATES) > 0)
    steps = CHANGE * (1.0 - np.eye(STATES)) + costs[1:, None]
    states = cheapest_states(costs[0], steps)
    gain = float((residuals[:, 0] - residuals[np.arange(frames), states]).mean())
    enough = gain >= LEAST_GAIN and (states > 0).mean() <= LARGEST_SHARE
    return states if enough else np.zeros_like(states)


def _residuals(
    motion: Float[np.ndarray, "N J 3"], films: Sequence[Keypoints2D]
) -> tuple[float, Float[np.ndarray, "T S"]]:
    """Cost of the best camera and warp, each frame in its best state, and the residuals of all."""
    directions = camera_directions(DIRECTIONS)
    residuals = [pose_residuals(motion, film, directions) for film in films]
    penalised = [x + SWAPPED * (k > 0) for k, x in enumerate(residuals)]
    better = np.minimum.reduce(penalised)
    totals = warp_costs(better)
    best = int(totals.argmin())
    path, frames = warp_path(better[best]), np.arange(better.shape[1])
    of_frames = np.stack([x[best][frames, path] for x in residuals], axis=1)
    return float(totals[best]), of_frames
