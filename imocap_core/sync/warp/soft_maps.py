"""Soft maps from squared distances: P(position in another video | frame).

Evidence for a counterpart of a frame in the other video, or against one. A frame whose nearest pose
in the other video is unlike it may have no counterpart, but that is weaker evidence than a Gaussian
error makes it: monocular estimates of one pose from two sides may differ by several times the usual
distance, and as long as the pose lasts. So evidence grows with the logarithm of the distance, and
what speaks against a match counts by how much the pose changes: a performer who stands still is one
observation, however long.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.sync.affinity import DistanceMatrix
from imocap_core.sync.maps import BandedMap, refined_bands
from imocap_core.sync.warp.monotone import StepPrior, banded_posterior
from imocap_core.sync.warp.rate import banded_rate_posterior, rate_prior
from imocap_core.sync.warp.template import NearbySquares


class PairClock(NamedTuple):
    """Frame rates of two videos in the action's time, and that of the first one's evidence (as of
    `Clocks`)."""

    fps: float
    fps_to: float
    evidence_fps: float


@dataclass(frozen=True)
class Clocks:
    """Frame rates and playback rates of the videos.

    Attributes:
        fps: frames per second of each file.
        rates: seconds of the action per second of each video: 1/8 = slow motion by 8.
    """

    fps: Sequence[float]
    rates: Float[np.ndarray, " M"]

    @property
    def action_fps(self) -> list[float]:
        """Frames per second of the action."""
        return [f / float(r) for f, r in zip(self.fps, self.rates, strict=True)]

    @property
    def evidence_fps(self) -> list[float]:
        """Frames per second in which errors of estimates persist: the geometric mean of the video's
        and the action's, because errors come partly of pictures, partly of poses."""
        return [f / float(np.sqrt(r)) for f, r in zip(self.fps, self.rates, strict=True)]

    def pair(self, i: int, j: int, n: int = 1) -> PairClock:
        """Video i compared with video j, by every n-th frame of both."""
        fps = self.action_fps
        return PairClock(fps[i] / n, fps[j] / n, self.evidence_fps[i] / n)


GAIN = 2.0  # nats per observation when the distance changes by a factor of e
PRIOR = 0.5  # in favour of a counterpart, nats per observation


def evidence_of_match(
    nearest: Float[np.ndarray, " N"],
    change: Float[np.ndarray, " N"],
    *,
    matched_square: float,
    level: float,
    observations: float,
) -> Float[np.ndarray, " N"]:
    """Log likelihood ratio of a counterpart against none, of each frame's nearest pose.

    Args:
        nearest: squared distance of the nearest pose of the other video.
        change: squared change of the pose around the frame (`pose_change`).
        matched_square: typical of `nearest` where there is a counterpart.
        level: but for the prior, the ratio is 0 at (1 + 2 level) matched_square; inf: every frame
            has a counterpart.
        observations: independent ones per frame.
    """
    if not np.isfinite(level):
        return np.full(len(nearest), np.inf)
    log_ratio = GAIN * np.log((2.0 + 2.0 * level) / (1.0 + nearest / matched_square))
    novelty = -np.expm1(-change / matched_square)
    against = np.where(log_ratio < 0, novelty, 1.0)
    return np.asarray(observations * (against * log_ratio + PRIOR))


# cost of a frame of the other video left over at an end, as a share of that of a matching pair
SKIPPED_SHARE = 0.3
# Share of warps whose rate changes slowly, spread of a rate's logarithm, and how long it persists
_REGULARITY, _RATE_SPREAD, _RATE_PERSISTENCE_S = 0.5, 0.7, 1.0
# a frame of other content (a cutaway, a wrong person) rules no position out: at most this much more
# squared distance counts than at its nearest pose, in units of that of matching frames
FARTHEST = 5.0
LARGEST_USUAL = 4.0  # times the usual rate: faster than that is a leap
LEAP = 0.05  # how much less likely a leap is than a usual step
UNLIKELY = 1e-9  # of a row's largest entry: where a map of every n-th frame rules positions out
NEAR_S = 0.5  # beyond the others a map of all frames may lie
MOST_OBSERVATIONS = 4.0  # independent ones per frame, however low the frame rate


def observations_per_frame(evidence_per_s: float, fps: float) -> float:
    """Independent observations of the pose per frame: the squared distance of matching frames
    costs this many nats."""
    return min(evidence_per_s / fps, MOST_OBSERVATIONS)


def soft_map(
    squares: NearbySquares,
    matched_square: float,
    change: Float[np.ndarray, " N"],
    clock: PairClock,
    params: SyncParams,
    *,
    per_frame: int,
    smooth_rate_share: float,
) -> tuple[BandedMap, Float[np.ndarray, " N"]]:
    """Soft map of one video into another from squared distances, and P(matched) of each frame.

    The mean over all monotone warps, and, with weight `smooth_rate_share`, over those of slowly
    changing rate: the first is right where frames were left out, the second where a performance
    went on.

    Args:
        matched_square: typical squared distance of matching frames.
        change: squared change of the first video's pose around each frame (`pose_change`).
        per_frame: positions (columns) per frame of the second video.
    """
    observations = observations_per_frame(params.evidence_per_s, clock.evidence_fps)
    comparable = np.isfinite(squares.least)
    cost = _costs(squares, matched_square, observations)
    unmatched = evidence_of_match(
        np.where(comparable, squares.least, matched_square),
        change,
        matched_square=matched_square,
        level=params.unmatched_level,
        observations=observations,
    )
    usual = clock.fps_to / clock.fps * per_frame
    steps = step_prior(usual, params.max_rate)
    posterior, matched = banded_posterior(cost, unmatched=unmatched, steps=steps)
    if smooth_rate_share == 0:
        return posterior, matched
    prior = rate_prior(
        usual=usual,
        spread=_RATE_SPREAD,
        persistence_s=_RATE_PERSISTENCE_S,
        max_rate=params.max_rate,
        fps=clock.fps,
    )
    skipped = SKIPPED_SHARE * observations / usual
    smooth, smooth_matched = banded_rate_posterior(
        cost, prior, unmatched=unmatched, skipped=skipped
    )
    values = [
        (1 - smooth_rate_share) * a + smooth_rate_share * b
        for a, b in zip(posterior.values, smooth.values, strict=True)
    ]
    return (
        BandedMap(posterior.shape, posterior.bands, values),
        (1 - smooth_rate_share) * matched + smooth_rate_share * smooth_matched,
    )


def _costs(squares: NearbySquares, matched_square: float, observations: float) -> BandedMap:
    """Nats by which each position is less likely than the frame's nearest pose."""
    least = np.nan_to_num(squares.least)

    def of(rows: slice, _: slice, values: np.ndarray) -> np.ndarray:
        valid = np.isfinite(values)
        filled = values if valid.all() else _with_row_means(values, valid)
        nearest = np.minimum(least[rows], filled.min(axis=1))
        farther = filled - nearest[:, None]
        farther /= matched_square
        np.minimum(farther, FARTHEST, out=farther)
        farther *= observations
        return farther

    return squares.nearby.mapped(of)


def _with_row_means(squares: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Squares (N, S) with the mean of its row, or 0, for each unknown one."""
    mean = np.divide(
        np.where(valid, squares, 0.0).sum(axis=1),
        valid.sum(axis=1),
        out=np.zeros(len(squares)),
        where=valid.any(axis=1),
    )
    return np.where(valid, squares, mean[:, None])


def step_prior(usual: float, max_rate: float) -> StepPrior:
    """Steps about the usual one, of up to LARGEST_USUAL times it, and up to `max_rate` by leaps."""
    largest = int(np.ceil(min(max_rate * usual, 1e9)))
    most = min(int(np.ceil(LARGEST_USUAL * usual)), largest)
    return StepPrior(most, largest, LEAP, decay=usual / (1.0 + usual))


def pairwise_soft_map(
    i: int, j: int, distances: DistanceMatrix, clocks: Clocks, params: SyncParams
) -> tuple[BandedMap, Float[np.ndarray, " N"]]:
    """Soft map of video i into video j at whole frames, and P(matched) of each frame.

    Of long videos first the map of every n-th frame; then that of all frames, near it.
    """
    n = distances.stride(i, j)
    squares = NearbySquares.of(distances.block(i, j))
    if n > 1:
        coarse, _ = _map_of_every(n, squares, i, j, distances, clocks, params)
        reach = round(NEAR_S * clocks.action_fps[j])
        shape = distances.blocks.lengths[i], distances.blocks.lengths[j]
        squares = NearbySquares.computed(
            shape,
            refined_bands(coarse.trimmed(UNLIKELY), shape, n, reach),
            partial(distances.part, i, j),
        )
    return _map_of_every(1, squares, i, j, distances, clocks, params)


def _map_of_every(
    n: int,
    squares: NearbySquares,
    i: int,
    j: int,
    distances: DistanceMatrix,
    clocks: Clocks,
    params: SyncParams,
) -> tuple[BandedMap, Float[np.ndarray, " N"]]:
    """Soft map of every n-th frame of video i into every n-th of video j."""
    return soft_map(
        squares,
        typical_matched_square(squares.least, distances),
        distances.change[i][::n],
        clocks.pair(i, j, n),
        params,
        per_frame=1,
        smooth_rate_share=_REGULARITY,
    )


def typical_matched_square(least: Float[np.ndarray, " N"], distances: DistanceMatrix) -> float:
    """Typical squared distance of matching frames of one pair: the median of the rows' least."""
    valid = np.isfinite(least)
    typical = float(np.median(least[valid])) if valid.any() else distances.matched_square
    return max(typical, distances.least_square, 1e-6 * distances.matched_square)


def at_fine_positions(soft_map: BandedMap, per_frame: int) -> BandedMap:
    """A row-stochastic map at whole frames, interpolated to `per_frame` positions a frame."""
    N, S = soft_map.shape
    bands, parts = [], []
    for rows, columns, values in soft_map:
        # the entries beside the band are 0
        before, after = int(columns.start > 0), int(columns.stop < S)
        coarse = np.pad(values.astype(float), ((0, 0), (before, after)))
        fine = np.empty((len(coarse), (coarse.shape[1] - 1) * per_frame + 1))
        fine[:, ::per_frame] = coarse
        for k in range(1, per_frame):
            x = k / per_frame
            fine[:, k::per_frame] = (1 - x) * coarse[:, :-1] + x * coarse[:, 1:]
        first = (columns.start - before) * per_frame
        bands.append((rows, slice(first, first + fine.shape[1])))
        parts.append(fine / np.maximum(fine.sum(axis=1, keepdims=True), 1e-300))
    return BandedMap((N, (S - 1) * per_frame + 1), bands, parts)
