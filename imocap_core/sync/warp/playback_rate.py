"""Playback rates of videos: slow motion and time lapse, from the poses.

The rate of one video in another is read from the posterior over all warps of slowly changing rate
(`smooth_rate`), on few frames and with a prior of heavy tails: half of all videos play within a
third of the usual speed, and slow motion by eight is no miracle. The rates of all pairs are
differences of one number a video, solved together by robust least squares.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.robust import geman_mcclure_weight
from imocap_core.sync.pairwise.procrustes import procrustes_distances
from imocap_core.sync.warp.rate_prior import RATE_GRID, RatePrior
from imocap_core.sync.warp.smooth_rate import rate_posterior

COARSE_FRAMES = 120  # of each video, evenly spaced
LARGEST_RATE = 20.0  # of one video in another
USUAL_SPREAD = 0.3  # of the logarithm of a rate: scale of a Cauchy distribution
CHANGES = 1.0  # of the rate in a video, a priori
OBSERVATIONS_PER_S = 15.0
UNMATCHED = 4.0  # squared distance of a frame without counterpart, over that of matching ones
SKIPPED = 1.0  # share of a matching frame's cost: frame left over at an end
PERFORMED_RATE = 2.2  # performances of one action differ by up to this factor
ROUNDS = 10  # of iteratively reweighted least squares
SCALE = 0.3  # of the Geman-McClure weights, log units


def playback_rates(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    fps: Sequence[float],
    max_rate: float,
) -> Float[np.ndarray, " M"]:
    """Seconds of the action per second of each video, over the median video's (of two videos, over
    the faster one's): 1/8 = slow motion by 8.

    Exactly 1 for videos that differ by no more than performances do, or less than twice the
    uncertainty; at most `max_rate` either way.

    Args:
        poses: of one body scale. weights: of the joints.
    """
    log_rate, deviation = log_playback_rates(poses, weights, fps)
    limited = np.clip(log_rate, -np.log(max_rate), np.log(max_rate))
    retimed = (np.abs(limited) > np.log(PERFORMED_RATE)) & (np.abs(limited) > 2 * deviation)
    return np.where(retimed, np.exp(limited), 1.0)


def log_playback_rates(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    fps: Sequence[float],
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """Logarithms of the playback rates as estimated, and their standard deviations."""
    M = len(poses)
    coarse = [_thinned(len(x)) for x in poses]
    log_rates, precision = np.zeros((M, M)), np.zeros((M, M))
    for i in range(M):
        for j in range(i + 1, M):
            a, b = coarse[i], coarse[j]
            squares = procrustes_distances(poses[i][a], poses[j][b], weights[i][a], weights[j][b])
            squares = squares**2
            if not np.isfinite(squares).any():
                continue
            squares = np.where(np.isfinite(squares), squares, np.nanmean(squares))
            rates = [fps[v] * len(coarse[v]) / len(poses[v]) for v in (i, j)]
            forward = _log_rate(squares, rates[0], rates[1])
            backward = _log_rate(squares.T, rates[1], rates[0])
            log_rates[i, j] = 0.5 * (forward[0] - backward[0])
            disagreement = 0.25 * (forward[0] + backward[0]) ** 2
            precision[i, j] = 1.0 / (0.5 * (forward[1] + backward[1]) + disagreement + 1e-3)
    return _per_video(log_rates, precision)


def _thinned(frames: int) -> np.ndarray:
    """At most COARSE_FRAMES evenly spaced frames."""
    return np.unique(np.linspace(0, frames - 1, min(frames, COARSE_FRAMES)).round().astype(int))


def _log_rate(squares: np.ndarray, fps: float, fps_to: float) -> tuple[float, float]:
    """Median logarithm of the rate over the frames of the first video, and its variance."""
    N = len(squares)
    typical = max(float(np.median(squares.min(axis=1))), 1e-12)
    observations = min(OBSERVATIONS_PER_S / fps, 1.0)
    prior = heavy_tailed_prior(fps_to / fps, min(CHANGES / N, 0.5))
    share = rate_posterior(
        observations / typical * squares,
        prior,
        unmatched=observations * UNMATCHED,
        skipped=SKIPPED * observations * fps / fps_to,
    ).mean(axis=0)
    log_rate = np.log(prior.advance * fps / fps_to)
    middle = float(np.interp(0.5, np.cumsum(share) - 0.5 * share, log_rate))
    return middle, float(share @ (log_rate - middle) ** 2)


def heavy_tailed_prior(usual: float, change: float) -> RatePrior:
    """Rates around `usual` positions per frame, Cauchy in their logarithm; one persists but for
    changes of probability `change` a frame to any other."""
    side = int(np.ceil(np.log(LARGEST_RATE) / RATE_GRID))
    log_rate = np.linspace(-1, 1, 2 * side + 1) * np.log(LARGEST_RATE)
    share = 1.0 / (1.0 + (log_rate / USUAL_SPREAD) ** 2)
    share /= share.sum()
    moves = (1.0 - change) * np.eye(len(share)) + change * share
    return RatePrior(usual * np.exp(log_rate), share, moves)


def _per_video(
    log_rates: Float[np.ndarray, "M M"], precision: Float[np.ndarray, "M M"]
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """The numbers x of (upper) median 0 with log_rates[i, j] = x[i] - x[j] for i < j, by robust
    least squares, and their standard deviations against the other videos together."""
    M = len(log_rates)
    i, j = np.triu_indices(M, 1)
    A = np.zeros((len(i), M))
    A[np.arange(len(i)), i], A[np.arange(len(i)), j] = 1.0, -1.0
    b, weight = log_rates[i, j], precision[i, j]
    robust, x = np.ones(len(b)), np.zeros(M)
    for _ in range(ROUNDS):
        W = (robust * weight)[:, None]
        x = np.linalg.solve(A.T @ (W * A) + 1e-3 * np.eye(M), A.T @ (W[:, 0] * b))
        robust = geman_mcclure_weight(np.abs(A @ x - b), SCALE)
    information = np.abs(A).T @ (robust * weight)
    return x - np.sort(x)[M // 2], 1.0 / np.sqrt(information + 1e-9)
