"""Calibrated confidence of matches: the probability that a match is right within the reach.

The mass of a soft map around its median is a posterior under the model's assumptions, of which two
fail: errors of estimates persist, and a monotone warp has to place every frame somewhere. What
reveals such failures enters a logistic regression beside the mass: the disagreement of the routes
through the other videos, the pose distance of the match, time that stalls while the performer
moves, a map that fits a repetition later as well. Its weights were fitted on scenes of training
clips (tools/fit_sync_confidence.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d
from scipy.special import expit, logit

from imocap_core.sync.map_consistency import PairMaps, composed
from imocap_core.sync.pairwise.banded import blocks_of_frames
from imocap_core.sync.pairwise.distance_matrix import DistanceMatrix
from imocap_core.sync.repeated_motion import Repetition

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
    others = {i for i, _ in pairs.positions} - {v, r}
    routes = [pairs.positions[v, r]]
    routes += [composed(pairs.positions[v, u], pairs.positions[u, r]) for u in sorted(others)]
    away = np.abs(np.stack(routes) - positions)
    out = np.full(len(positions), route.reach_frames)
    some = np.isfinite(away).any(axis=0)
    out[some] = np.nanmedian(away[:, some], axis=0)
    return out
