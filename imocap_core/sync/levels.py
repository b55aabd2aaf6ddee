"""How well do two videos fit along the warp that fits them best?

The matched level of video i in video j is the root-mean-square pose distance between i's frames
and their counterparts in j, over the frames that fit best. Every frame has a counterpart here, so
the share that is left out is what one video may show and the other not. Two videos of one action
have the level of the estimates' noise plus what differs between performances; a video of another
action lies above that, however its frames are warped.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.affinity import procrustes_distances
from imocap_core.sync.monotone import monotone_posterior

Array = NDArray[np.float64]

RATE_PER_S = 15.0  # estimates err for about a quarter of a second: more frames tell little more
LOOKS_PER_S = 15.0
FITTING_SHARE = 0.6  # of the frames; what is left out is room for what only one video shows


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
) -> dict[tuple[int, int], Array]:
    """Squared pose distances (T_i, T_j) of all videos i < j to the `others` j."""
    return {
        (i, j): procrustes_distances(poses[i], others[j], weights[i], others_weights[j]) ** 2
        for i in range(len(poses))
        for j in range(i + 1, len(poses))
    }


def typical_square(squares: dict[tuple[int, int], Array]) -> float:
    """What the nearest pose of another video typically has, mean over the pairs of videos."""
    near = []
    for square in squares.values():
        known = square[np.isfinite(square).any(axis=1)]
        if known.size:
            near.append(float(np.median(np.nanmin(known, axis=1))))
    return max(float(np.mean(near)), 1e-12) if near else 1.0


def expected_squares(
    squares: dict[tuple[int, int], Array], fps: Sequence[float], near: float, max_rate: float
) -> dict[tuple[int, int], Array]:
    """Squared distance of each frame of video i to where it lies in video j, for all i != j: the
    mean over all monotone warps, frames without any known distance left out.

    `squares` of i < j as from `squares_between`; `near`: a typical square of matching poses;
    `max_rate`: most seconds of one video per second of another.
    """
    out = {}
    for (i, j), square in squares.items():
        out[i, j] = _expected(square, fps[i], fps[j], near, max_rate)
        out[j, i] = _expected(square.T, fps[j], fps[i], near, max_rate)
    return out


def matched_levels(
    expected: dict[tuple[int, int], Array], count: int, *, share: float = FITTING_SHARE
) -> Array:
    """Matched level (M, M) of video i in video j, in the unit of the poses: over the `share` of the
    frames that fit best. NaN where two videos share no joints, and on the diagonal."""
    levels = np.full((count, count), np.nan)
    for (i, j), square in expected.items():
        if len(square):
            best = np.sort(square)[: max(1, int(np.ceil(share * len(square))))]
            levels[i, j] = np.sqrt(best.mean())
    return levels


def alignment_gains(
    squares: dict[tuple[int, int], Array],
    fps: Sequence[float],
    near: float,
    max_rate: float,
    count: int,
) -> Array:
    """How much better each video (M,) fits the others in their order of time than out of it.

    The logarithm of the mean matched level with the others run backwards or begun at another
    moment, over the matched level; mean over the two others it fits best. About 0 for a video of
    another action, whose frames follow nobody's order.
    """
    levels = matched_levels(expected_squares(squares, fps, near, max_rate), count)
    scrambled = [
        matched_levels(
            expected_squares({k: turn(s) for k, s in squares.items()}, fps, near, max_rate), count
        )
        for turn in (_backwards, _begun(1 / 3), _begun(1 / 2), _begun(2 / 3))
    ]
    gains = np.log(np.mean(scrambled, axis=0) / np.maximum(levels, 1e-12))
    better = np.fmax(gains, gains.T)
    out = np.full(count, np.nan)
    for v in range(count):
        own = np.delete(better[v], v)
        own = np.sort(own[np.isfinite(own)])
        out[v] = own[-2:].mean() if len(own) else np.nan
    return out


def _backwards(square: Array) -> Array:
    return square[:, ::-1]


def _begun(share: float) -> Callable[[Array], Array]:
    return lambda square: np.roll(square, round(share * square.shape[1]), axis=1)


def _expected(square: Array, fps: float, fps_to: float, near: float, max_rate: float) -> Array:
    known = np.isfinite(square)
    if not known.any():
        return np.zeros(0)
    filled = np.where(known, square, square[known].mean())
    step = max_rate * fps_to / fps
    max_step = max(1, int(np.ceil(step))) if np.isfinite(step) else None
    cost = LOOKS_PER_S / fps / near * filled
    maps, _ = monotone_posterior(cost, unmatched=np.inf, max_step=max_step)
    return np.asarray((maps * filled).sum(axis=1)[known.any(axis=1)])
