"""Calibrated confidence of matches, and matches that are a whole repetition off.

A walk that begins in another cycle fits nearly as well a cycle later, in every frame alike: no
frame's own evidence reveals it. So a map is compared with itself, shifted to the next repetition.

Confidence: the probability that a match is right within the reach. The mass of a soft map around
its median is a posterior under assumptions of which two fail: errors of estimates persist, and a
monotone warp has to place every frame somewhere. What reveals such failures enters a logistic
regression beside the mass: disagreement with routes through the other videos, the match's pose
distance, time that stalls while the performer moves, a map that fits a repetition later as well.
Its weights were fitted on scenes of training clips (tools/fit_sync_confidence.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import minimum_filter1d, uniform_filter1d
from scipy.special import expit, logit

from imocap_core.sync.affinity import DistanceMatrix
from imocap_core.sync.maps import blocks_of_frames
from imocap_core.sync.time_axis import PairMaps

DISTINCT = 1.6  # times the distance of the match: a shifted map that fits worse is no alternative
LEAST_S, SLACK_S = 0.4, 0.1  # of a repetition; a shifted match may lie this much beside it
# mean squared distance of a cycle to the next one, over that at the lag where it is largest. By a
# detector's poses of eight real sets: 0.02 to 0.15 of what repeats (skipping a rope, push-ups,
# walking), 0.38 to 0.99 of what does not (throws, strokes, one squat); captured stairs 0.18 to 0.27
RECURRING = 0.3
OVERLAP = 0.6  # of the matched frames, that a shifted map must still match


@dataclass(frozen=True)
class Repetition:
    """The map shifted by a repetition that fits best.

    Attributes:
        shift_frames: of the other video, signed.
        ratio: its mean squared distance over that of the map; below DISTINCT.
    """

    shift_frames: float
    ratio: float

    @property
    def evidence(self) -> float:
        """Logarithm of DISTINCT over the ratio."""
        return float(np.log(DISTINCT / self.ratio))


def next_repetition(
    squares: Float[np.ndarray, "T S"],
    positions: Float[np.ndarray, " T"],
    matched: Bool[np.ndarray, " T"],
    fps_to: float,
) -> Repetition | None:
    """The best map shifted by a repetition; None where the motion does not repeat.

    Shifted maps count where the distance has first risen to DISTINCT times that of the match: a
    performer who stands still repeats nothing.

    Args:
        squares: squared distances, NaN unknown.
        positions: of the frames in the other video, anything where not matched.
        fps_to: of the other video, in the action's time.
    """
    rows = np.flatnonzero(matched)
    if not len(rows):
        return None
    slack = round(SLACK_S * fps_to)
    distance = np.where(np.isfinite(squares), squares, np.inf)
    near = minimum_filter1d(distance, 2 * slack + 1, axis=1)
    columns = np.rint(positions[rows]).astype(int)
    ratios: dict[int, float] = {}
    for direction in (1, -1):
        rise = 1.0
        for shift in range(1, squares.shape[1]):
            ratio = _ratio(near, rows, columns, direction * shift)
            if ratio is None:
                break
            if rise >= DISTINCT and shift >= LEAST_S * fps_to:
                ratios[direction * shift] = ratio
            rise = max(rise, ratio)
    best = min(ratios, key=lambda shift: ratios[shift], default=0)
    if not ratios or ratios[best] >= DISTINCT:
        return None
    beside = [shift for shift in ratios if abs(shift - best) <= 2 * slack]
    exact = min(beside, key=lambda shift: _ratio(distance, rows, columns, shift) or np.inf)
    return Repetition(float(exact), ratios[best])


def repeats(squares: Float[np.ndarray, "T T"], period: float, slack: float) -> bool:
    """Whether a video shows two cycles of about `period` frames, one after the other.

    Args:
        squares: squared distances between its own frames.
        slack: frames by which the period may be wrong.
    """
    lags = range(max(2, round(period - slack)), round(period + slack) + 1)
    return any(_recurrence(squares, lag) <= RECURRING for lag in lags)


def _recurrence(squares: np.ndarray, lag: int) -> float:
    """Of the most alike two successive stretches of `lag` frames, their mean squared distance over
    that at the worst of all smaller lags; infinite where the video is shorter than both."""
    begins = len(squares) - 2 * lag + 1
    if begins < 1:
        return float("inf")
    means = np.stack(
        [
            sliding_window_view(np.diagonal(squares, k), lag).mean(axis=1)[:begins]
            for k in range(1, lag + 1)
        ]
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = means[-1] / means.max(axis=0)
    return float(np.nanmin(ratios, initial=np.inf))


def _ratio(squares: np.ndarray, rows: np.ndarray, columns: np.ndarray, shift: int) -> float | None:
    """Mean distance of the shifted map over that of the map, both where both are known; None
    where the shifted map leaves the other video."""
    shifted = columns + shift
    inside = (shifted >= 0) & (shifted < squares.shape[1])
    if inside.mean() < OVERLAP:
        return None
    here = squares[rows[inside], columns[inside]]
    there = squares[rows[inside], shifted[inside]]
    valid = np.isfinite(here) & np.isfinite(there)
    if not valid.any():
        return 1.0
    return float(max(there[valid].mean(), 1e-12) / max(here[valid].mean(), 1e-12))


WINDOW_S = 0.5  # over which rates and distances are averaged
LEAST_RATE = 0.05
ENTRIES_AT_ONCE = 1 << 20
# feature: weight in the regression
WEIGHTS = {
    "one": -2.231,
    "mass": 0.913,
    "disagreement": -0.412,
    "mean_mass": 0.491,
    "distance": -0.061,
    "ambiguity": 0.662,
    "stall": -2.153,
    "slowness": -0.553,
    "stillness": -0.448,
    "repetition": -0.75,  # fitted alone, on walks that start in any cycle
}


@dataclass(frozen=True)
class Route:
    """The match of video v with the reference.

    Attributes:
        positions: of its frames in the reference, NaN unmatched. mass: of the soft map within the
            reach.
        fps: frames per second of the action, of the video. fps_to: of the reference.
        reach_frames: of the reference. repetition: see `next_repetition`.
    """

    v: int
    reference: int
    positions: Float[np.ndarray, " T"]
    mass: Float[np.ndarray, " T"]
    fps: float
    fps_to: float
    reach_frames: float
    repetition: Repetition | None = None


def calibrated_confidence(
    route: Route, distances: DistanceMatrix, pairs: PairMaps
) -> Float[np.ndarray, " T"]:
    """Probability (T,) that each match is right within the reach; 0 where unmatched."""
    features = confidence_features(route, distances, pairs)
    return np.where(
        np.isfinite(route.positions), expit(features @ np.array(list(WEIGHTS.values()))), 0.0
    )


def confidence_features(
    route: Route, distances: DistanceMatrix, pairs: PairMaps
) -> Float[np.ndarray, "T F"]:
    """The features of each frame, in the order of WEIGHTS."""
    T, matched = len(route.positions), np.isfinite(route.positions)
    window = max(3, round(WINDOW_S * route.fps))
    frames = np.arange(T)
    filled = frames.astype(float)
    if matched.any():
        filled = np.interp(frames, frames[matched], route.positions[matched])
    rate = _local_rate(filled, window) * route.fps / route.fps_to
    here, ambiguity = _distances(route, filled, distances)
    mass = logit(np.clip(route.mass, 0.01, 0.99))
    novelty = -np.expm1(-distances.change[route.v] / distances.matched_square)
    slowness = np.maximum(0.0, -np.log(rate + LEAST_RATE))
    return np.column_stack(
        [
            np.ones(T),
            mass,
            np.log1p(_disagreement(route, filled, pairs) / route.reach_frames),
            np.full(T, mass[matched].mean() if matched.any() else 0.0),
            np.log(0.05 + uniform_filter1d(here, window, mode="nearest")),
            ambiguity,
            slowness * novelty,
            slowness,
            1.0 - novelty,
            np.full(T, 0.0 if route.repetition is None else route.repetition.evidence),
        ]
    )


def _distances(
    route: Route, positions: np.ndarray, distances: DistanceMatrix
) -> tuple[np.ndarray, np.ndarray]:
    """Squared distance (T,) of each match, 1 where unknown, and `_ambiguity` (T,), of which long
    videos have that of every n-th frame of the reference."""
    T, S = len(positions), distances.blocks.lengths[route.reference]
    n = distances.stride(route.v, route.reference)
    nearest = np.clip(np.rint(positions).astype(int), 0, S - 1)
    here, ambiguity = np.empty(T), np.empty(T)
    for rows in blocks_of_frames(T, max(1, ENTRIES_AT_ONCE * n // S)):
        square = distances.part(route.v, route.reference, rows, slice(None, None, n))
        square = square / distances.matched_square
        ambiguity[rows] = _ambiguity(square, route.reach_frames / n)
        here[rows] = square[np.arange(len(square)), nearest[rows] // n]
    return np.where(np.isfinite(here), here, 1.0), ambiguity


def _local_rate(positions: np.ndarray, window: int) -> np.ndarray:
    """Steps (T,) per frame, over `window` frames."""
    T, half = len(positions), max(1, window // 2)
    before = np.maximum(np.arange(T) - half, 0)
    after = np.minimum(np.arange(T) + half, T - 1)
    return np.asarray((positions[after] - positions[before]) / np.maximum(after - before, 1))


def _ambiguity(squares: np.ndarray, reach_frames: float) -> np.ndarray:
    """Logarithm of the number (T,) of stretches of the reference, as long as the reach on both
    sides, whose poses are as near as the nearest."""
    compared = np.isfinite(squares)
    least = np.min(squares, axis=1, keepdims=True, where=compared, initial=np.inf)
    farther = np.where(compared, squares, 0.0) - np.where(np.isfinite(least), least, 0.0)
    near = np.where(compared | ~np.isfinite(least), np.exp(-0.5 * np.maximum(farther, 0.0)), 0.0)
    near = near.sum(axis=1)
    return np.asarray(np.log(near / (2.0 * reach_frames)))


def _disagreement(route: Route, positions: np.ndarray, pairs: PairMaps) -> np.ndarray:
    """Median distance (T,), frames of the reference, of the pairwise maps, direct and through each
    other video, from the match; that of the reach where no map leads there."""
    v, r = route.v, route.reference
    routes = [pairs.positions[v, r], *pairs.through(v, r)]
    away = np.abs(np.stack(routes) - positions)
    out = np.full(len(positions), route.reach_frames)
    some = np.isfinite(away).any(axis=0)
    out[some] = np.nanmedian(away[:, some], axis=0)
    return out
