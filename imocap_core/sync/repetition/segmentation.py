"""Repetitions of one action in a long clip, found by comparing the clip with itself.

A part of the clip is taken as a template and looked for everywhere else (`occurrences`). What
counts is how much of the clip its *other* occurrences explain, each pose the more the closer it
is. That one number decides length and number together: two repetitions as one template explain one
occurrence less, half a repetition explains half, unlike parts explain nothing.

All of this runs on poses that are evenly spaced in motion, not in time: holds and pauses shrink, so
they neither count as repetitions nor strain the warp.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from imocap_core.params import RepetitionParams
from imocap_core.sync.pairwise.affinity import procrustes_distances
from imocap_core.sync.repetition.template_matching import Span, best_template

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LOOK_S = 0.2  # speed is read over this time, longer than an estimate's jitter
SMOOTH_S = 0.1  # poses and speeds are smoothed over this time
SAMPLES_PER_S = 10.0  # of motion at its typical speed
HOLD_SHARE = 0.15  # of the typical speed: a hold passes at this rate, not at none
FASTEST_SHARE = 2.0
STILL_SHARE = 0.25  # of the typical speed: below it a repetition has ended or not begun
LIKE_BEST = 0.97  # templates that explain this share of what the best one does are as good
MAX_STARTS = 250  # templates tried begin at most at so many places


@dataclass(frozen=True)
class Repetitions:
    """spans: first and one past the last frame of each repetition, in order; the whole clip alone
    when there are none. score: share of the clip's motion that one repetition explains of what is
    not itself, at most 1. status: one sentence."""

    spans: tuple[Span, ...]
    score: float
    status: str


def find_repetitions(
    poses: Array,
    fps: float,
    params: RepetitionParams,
) -> Repetitions:
    """Cut a clip into the repetitions of its dominant action; their number is not given.

    Args:
        poses: (T, J, 3), any unit, axes and origin; NaN = missing.

    Raises:
        ValueError: for shapes or numbers that don't fit.
    """
    _check(poses, fps, params)
    whole = ((0, len(poses)),)
    smooth = _smoothed(poses, SMOOTH_S * fps)
    speed = _speeds(smooth, fps)
    typical = float(np.sqrt(np.mean(speed**2)))
    at = _evenly_in_motion(speed / typical, fps) if typical > 0 else np.array([0])
    shortest = max(2, round(params.shortest_s * SAMPLES_PER_S))
    if len(at) < 2 * shortest:
        return Repetitions(whole, 0.0, "no repetitions: the clip is too short, or nothing moves")
    worth = _worth(_squares(smooth[at]), shortest, params.match_level)
    found = best_template(
        worth,
        shortest=shortest,
        longest=max(shortest, round(0.6 * len(at))),
        stride=-(-len(at) // MAX_STARTS),
        least_quality=params.least_quality,
        cut_cost=speed[at] / typical,
        like_best=LIKE_BEST,
    )
    score = found.explained / max(len(at) - found.samples, 1) if found else 0.0
    if found is None or score < params.least_score or len(found.spans) < 2:
        status = f"no repetitions: score {score:.2f} < {params.least_score:g}"
        return Repetitions(whole, score, status)
    motion = speed - STILL_SHARE * typical
    edges = np.append(at, len(poses))
    spans = tuple(_trimmed(int(edges[a]), int(edges[b]), motion) for a, b in found.spans)
    lengths = np.diff(spans, axis=1) / fps
    said = f"{len(spans)} repetitions, {lengths.min():.2f} to {lengths.max():.2f} s each"
    return Repetitions(spans, score, f"{said}, score {score:.2f}")


def _check(poses: Array, fps: float, params: RepetitionParams) -> None:
    faults = []
    if poses.ndim != 3 or poses.shape[-1] != 3 or not len(poses):
        faults.append(f"poses: expected (T >= 1, J, 3), got {poses.shape}")
    numbers = (
        ("fps", fps),
        ("match_level", params.match_level),
        ("shortest_s", params.shortest_s),
    )
    faults += [f"{name}: expected > 0, got {value}" for name, value in numbers if not value > 0]
    if faults:
        raise ValueError("; ".join(faults))


def _smoothed(poses: Array, sigma: float) -> Array:
    """Poses smoothed over time (sigma in frames); a missing joint takes what its neighbours in time
    say, and stays NaN where none is near."""
    seen = np.isfinite(poses).all(axis=-1, keepdims=True).astype(float)
    total = gaussian_filter1d(np.where(seen > 0, poses, 0.0), sigma, axis=0, mode="nearest")
    share = gaussian_filter1d(seen, sigma, axis=0, mode="nearest")
    return np.where(share > 1e-3, total / np.maximum(share, 1e-3), np.nan)


def _speeds(poses: Array, fps: float) -> Array:
    """How fast the pose changes at each frame (T,), the body's own turning left out."""
    lag = max(1, round(LOOK_S * fps))
    if len(poses) <= lag:
        return np.zeros(len(poses))
    weights = np.isfinite(poses).all(axis=-1).astype(float)
    step = np.array(
        [
            procrustes_distances(
                poses[t : t + 1], poses[t + lag :][:1], weights[t : t + 1], weights[t + lag :][:1]
            )[0, 0]
            for t in range(len(poses) - lag)
        ]
    )
    middle = np.arange(len(step)) + lag / 2
    known = np.isfinite(step)
    if not known.any():
        return np.zeros(len(poses))
    return np.interp(np.arange(len(poses)), middle[known], step[known]) * fps / lag


def _evenly_in_motion(relative_speed: Array, fps: float) -> Ints:
    """Frames (N,) between which the pose changes by about equal amounts, increasing."""
    pace = np.clip(relative_speed, HOLD_SHARE, FASTEST_SHARE)
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]))]) / fps
    marks = np.arange(0.0, travelled[-1], 1.0 / SAMPLES_PER_S)
    return np.unique(np.searchsorted(travelled, marks))


def _squares(poses: Array) -> Array:
    """Squared distances of all pairs (N, N); unknown ones count as the mean."""
    weights = np.isfinite(poses).all(axis=-1).astype(float)
    square = procrustes_distances(poses, poses, weights, weights) ** 2
    return np.where(np.isfinite(square), square, np.nanmean(square))


def _worth(squares: Array, apart: int, match_level: float) -> Array:
    """1 for pairs as close as a pose's nearest one elsewhere (at least `apart` samples away), 0 at
    the match level, never below -1."""
    N = len(squares)
    elsewhere = np.abs(np.arange(N)[:, None] - np.arange(N)) >= apart
    near = float(np.median(np.where(elsewhere, squares, np.inf).min(axis=1)))
    reach = match_level * max(float(squares[elsewhere].mean()) - near, 0.0) + 1e-12
    return np.clip(1.0 - (squares - near) / reach, -1.0, 1.0)


def _trimmed(first: int, stop: int, motion: Array) -> Span:
    """The part of a span where most happens: the largest sum of `motion` (T,), which is negative
    where the performer is nearly still. Short stirs in a pause at its ends are left out with it."""
    total = np.concatenate([[0.0], np.cumsum(motion[first:stop])])
    lowest = np.minimum.accumulate(total)
    end = int(np.argmax(total - lowest))
    begin = int(np.argmin(total[: end + 1]))
    return (first + begin, first + end) if end > begin else (first, stop)
