"""Warp residual: the root-mean-square pose distance of two videos along their best warp.

The residual of video i in video j is the root-mean-square pose distance between i's frames and
their counterparts in j, each frame forced to have one. Two videos of one action have the residual
of the estimates' noise plus what differs between performances; a video of another action lies
above that, however its frames are warped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.procrustes import procrustes_distances
from imocap_core.sync.warp.monotone import monotone_posterior
from imocap_core.sync.warp.soft_maps import step_prior

PairArrays = dict[tuple[int, int], np.ndarray]  # per pair of videos, (T_i, T_j) or (T_i,)
PairNumbers = dict[tuple[int, int], float]

# estimates err for about a quarter of a second: more frames carry little more information
RATE_PER_S = 15.0
OBSERVATIONS_PER_S = 15.0
LEAST_SQUARE_M2 = 1e-4  # of matching poses, 1 cm


def thinned(
    poses: Sequence[Float[np.ndarray, "_T J _"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    fps: Sequence[float],
) -> tuple[list[Float[np.ndarray, "_T J _"]], list[Float[np.ndarray, "_T J"]], list[float]]:
    """Every n-th frame of each video, so that about RATE_PER_S are left; with their frame rates."""
    stride = [max(1, round(f / RATE_PER_S)) for f in fps]
    return (
        [x[::n] for x, n in zip(poses, stride, strict=True)],
        [w[::n] for w, n in zip(weights, stride, strict=True)],
        [f / n for f, n in zip(fps, stride, strict=True)],
    )


def squares_between(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    others: Sequence[Float[np.ndarray, "_T J 3"]],
    others_weights: Sequence[Float[np.ndarray, "_T J"]],
) -> PairArrays:
    """Squared pose distances (T_i, T_j) of all videos i < j to the `others` j."""
    return {
        (i, j): procrustes_distances(poses[i], others[j], weights[i], others_weights[j]) ** 2
        for i in range(len(poses))
        for j in range(i + 1, len(poses))
    }


def typical_squares(squares: PairArrays) -> PairNumbers:
    """Typical squared distance of the nearest pose of the other video, for each pair of videos."""
    typical = {}
    for pair, square in squares.items():
        valid = square[np.isfinite(square).any(axis=1)]
        nearest = float(np.median(np.nanmin(valid, axis=1))) if valid.size else 1.0
        typical[pair] = max(nearest, LEAST_SQUARE_M2)
    return typical


def expected_squares(
    squares: PairArrays,
    fps: Sequence[float],
    typical: PairNumbers,
    max_rate: float,
    scramble: Callable[[np.ndarray], np.ndarray] | None = None,
) -> PairArrays:
    """Expected squared distance (T_i,) of each frame of video i to its counterpart in video j, for
    all i != j: the mean over all monotone warps, frames without any valid distance left out.

    Args:
        squares: of i < j as from `squares_between`.
        typical: squared distance of matching poses.
        max_rate: largest rate, seconds of one video per second of another.
        scramble: change of the time of the second video, the columns of (T_i, T_j).
    """
    out = {}
    for (i, j), square in squares.items():
        for a, b, directed in ((i, j, square), (j, i, square.T)):
            scrambled = directed if scramble is None else scramble(directed)
            out[a, b] = _expected(scrambled, fps[a], fps[b], typical[i, j], max_rate)
    return out


def soft_maps(
    squares: PairArrays, fps: Sequence[float], typical: PairNumbers, max_rate: float
) -> PairArrays:
    """Soft maps (T_i, T_j) of all i != j, rows of sum 1.

    Arguments as of `expected_squares`; pairs without any valid distance are left out.
    """
    return {
        (a, b): _soft_map(_filled(directed), fps[a], fps[b], typical[i, j], max_rate)
        for (i, j), square in squares.items()
        if np.isfinite(square).any()
        for a, b, directed in ((i, j, square), (j, i, square.T))
    }


def expected_by(maps: PairArrays, squares: PairArrays) -> PairArrays:
    """`expected_squares` from `soft_maps` that are computed already."""
    return {
        (a, b): _expected_of(soft_map, squares[a, b] if a < b else squares[b, a].T)
        for (a, b), soft_map in maps.items()
    }


def warp_residuals(
    expected: PairArrays, count: int, *, share: float = 1.0
) -> Float[np.ndarray, "M M"]:
    """Warp residual of video i in video j, in the unit of the poses, over the `share` of the frames
    that fit best. NaN where two videos share no joints, and on the diagonal."""
    residuals = np.full((count, count), np.nan)
    for (i, j), square in expected.items():
        if len(square):
            best = np.sort(square)[: max(1, int(np.ceil(share * len(square))))]
            residuals[i, j] = np.sqrt(best.mean())
    return residuals


def _expected(
    square: np.ndarray, fps: float, fps_to: float, typical: float, max_rate: float
) -> np.ndarray:
    if not np.isfinite(square).any():
        return np.zeros(0)
    return _expected_of(_soft_map(_filled(square), fps, fps_to, typical, max_rate), square)


def _expected_of(soft_map: np.ndarray, square: np.ndarray) -> np.ndarray:
    valid = np.isfinite(square).any(axis=1)
    return np.asarray((soft_map * _filled(square)).sum(axis=1)[valid])


def _filled(square: np.ndarray) -> np.ndarray:
    """Squared distances with the mean for the missing ones."""
    valid = np.isfinite(square)
    return np.where(valid, square, square[valid].mean())


def _soft_map(
    filled: np.ndarray, fps: float, fps_to: float, typical: float, max_rate: float
) -> np.ndarray:
    cost = OBSERVATIONS_PER_S / fps / typical * filled
    return monotone_posterior(cost, unmatched=np.inf, steps=step_prior(fps_to / fps, max_rate))[0]
