"""How well do two videos fit along the warp that fits them best?

The matched level of video i in video j is the root-mean-square pose distance between i's frames
and their counterparts in j, each frame forced to have one. Two videos of one action have the level
of the estimates' noise plus what differs between performances; a video of another action lies
above that, however its frames are warped.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.pairwise.affinity import procrustes_distances
from imocap_core.sync.warp.monotone import monotone_posterior

Array = NDArray[np.float64]
PairSquares = dict[tuple[int, int], Array]
PairNumbers = dict[tuple[int, int], float]

RATE_PER_S = 15.0  # estimates err for about a quarter of a second: more frames tell little more
LOOKS_PER_S = 15.0
LEAST_SQUARE_M2 = 1e-4  # of matching poses, 1 cm


def thinned(
    poses: Sequence[Array], weights: Sequence[Array], fps: Sequence[float]
) -> tuple[list[Array], list[Array], list[float]]:
    """Every n-th frame of each video, so that about RATE_PER_S are left; with their rates."""
    stride = [max(1, round(f / RATE_PER_S)) for f in fps]
    return (
        [x[::n] for x, n in zip(poses, stride, strict=True)],
        [w[::n] for w, n in zip(weights, stride, strict=True)],
        [f / n for f, n in zip(fps, stride, strict=True)],
    )


def squares_between(
    poses: Sequence[Array],
    weights: Sequence[Array],
    others: Sequence[Array],
    others_weights: Sequence[Array],
) -> PairSquares:
    """Squared pose distances (T_i, T_j) of all videos i < j to the `others` j."""
    return {
        (i, j): procrustes_distances(poses[i], others[j], weights[i], others_weights[j]) ** 2
        for i in range(len(poses))
        for j in range(i + 1, len(poses))
    }


def typical_squares(squares: PairSquares) -> PairNumbers:
    """What the nearest pose of the other video typically has, for each pair of videos."""
    near = {}
    for pair, square in squares.items():
        known = square[np.isfinite(square).any(axis=1)]
        typical = float(np.median(np.nanmin(known, axis=1))) if known.size else 1.0
        near[pair] = max(typical, LEAST_SQUARE_M2)
    return near


def expected_squares(
    squares: PairSquares,
    fps: Sequence[float],
    near: PairNumbers,
    max_rate: float,
    turn: Callable[[Array], Array] | None = None,
) -> PairSquares:
    """Squared distance of each frame of video i to where it lies in video j, for all i != j: the
    mean over all monotone warps, frames without any known distance left out.

    `squares` of i < j as from `squares_between`; `near`: a typical square of matching poses;
    `max_rate`: most seconds of one video per second of another; `turn`: what is done to the time
    of the video fitted into, the columns of (T_i, T_j).
    """
    out = {}
    for (i, j), square in squares.items():
        for a, b, own in ((i, j, square), (j, i, square.T)):
            turned = own if turn is None else turn(own)
            out[a, b] = _expected(turned, fps[a], fps[b], near[i, j], max_rate)
    return out


def soft_maps(
    squares: PairSquares, fps: Sequence[float], near: PairNumbers, max_rate: float
) -> PairSquares:
    """Where each frame of video i lies in video j, (T_i, T_j) for all i != j, rows of sum 1.

    Arguments as of `expected_squares`; pairs without any known distance are left out.
    """
    return {
        (a, b): _map(_filled(own), fps[a], fps[b], near[i, j], max_rate)
        for (i, j), square in squares.items()
        if np.isfinite(square).any()
        for a, b, own in ((i, j, square), (j, i, square.T))
    }


def expected_by(maps: PairSquares, squares: PairSquares) -> PairSquares:
    """`expected_squares` where the `soft_maps` are at hand."""
    return {
        (a, b): _along(soft, squares[a, b] if a < b else squares[b, a].T)
        for (a, b), soft in maps.items()
    }


def matched_levels(expected: PairSquares, count: int, *, share: float = 1.0) -> Array:
    """Matched level (M, M) of video i in video j, in the unit of the poses: over the `share` of the
    frames that fit best. NaN where two videos share no joints, and on the diagonal."""
    levels = np.full((count, count), np.nan)
    for (i, j), square in expected.items():
        if len(square):
            best = np.sort(square)[: max(1, int(np.ceil(share * len(square))))]
            levels[i, j] = np.sqrt(best.mean())
    return levels


def _expected(square: Array, fps: float, fps_to: float, near: float, max_rate: float) -> Array:
    if not np.isfinite(square).any():
        return np.zeros(0)
    return _along(_map(_filled(square), fps, fps_to, near, max_rate), square)


def _along(soft: Array, square: Array) -> Array:
    known = np.isfinite(square).any(axis=1)
    return np.asarray((soft * _filled(square)).sum(axis=1)[known])


def _filled(square: Array) -> Array:
    known = np.isfinite(square)
    return np.where(known, square, square[known].mean())


def _map(filled: Array, fps: float, fps_to: float, near: float, max_rate: float) -> Array:
    step = max_rate * fps_to / fps
    max_step = max(1, int(np.ceil(step))) if np.isfinite(step) else None
    cost = LOOKS_PER_S / fps / near * filled
    return monotone_posterior(cost, unmatched=np.inf, max_step=max_step)[0]
