"""Do the videos follow one order of time? What says more about an action than single poses do.

A free warp finds similar poses in almost any two videos. Windows of motion are harder to find by
chance: the poses of about 0.8 s, turned as one. Where the other video's time runs backwards or
begins elsewhere, a video of the same action fits clearly worse, and one of another action as well
as before.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.pairwise.view_axes import centred
from imocap_core.sync.screening.warp_residual import (
    PairNumbers,
    PairSquares,
    expected_squares,
    matched_levels,
)

Array = NDArray[np.float64]

OFFSETS_S = (-0.4, -0.2, 0.0, 0.2, 0.4)


def motion_windows(
    poses: Sequence[Array], weights: Sequence[Array], fps: Sequence[float]
) -> tuple[list[Array], list[Array]]:
    """Each frame with its neighbours, (T, 5 J, 3), every pose about its own centroid, and weights
    (T, 5 J); before the first frame and after the last one these stand in."""
    shown, counted = [], []
    for x, w, f in zip(poses, weights, fps, strict=True):
        about = centred(x, w)
        at = [np.clip(np.arange(len(x)) + round(s * f), 0, len(x) - 1) for s in OFFSETS_S]
        shown.append(np.concatenate([about[k] for k in at], axis=1))
        counted.append(np.concatenate([w[k] for k in at], axis=1))
    return shown, counted


def begun(share: float) -> Callable[[Array], Array]:
    """Squares (n, S) with the second video begun at another moment, its beginning last."""
    return lambda square: np.roll(square, round(share * square.shape[1]), axis=1)


def alignment_gains(
    squares: PairSquares, fps: Sequence[float], near: PairNumbers, max_rate: float
) -> Array:
    """How much better two videos fit in their order of time than out of it (M, M), symmetric.

    The logarithm of the mean matched level with one of them run backwards or begun at another
    moment, over the matched level; the better of the two directions. About 0 for a video of
    another action. Arguments as of `expected_squares`, squares of motion windows.
    """
    levels, *scrambled = (
        matched_levels(expected_squares(squares, fps, near, max_rate, turn), len(fps))
        for turn in (None, _backwards, begun(1 / 3), begun(1 / 2), begun(2 / 3))
    )
    gains = np.log(np.mean(scrambled, axis=0) / np.maximum(levels, 1e-12))
    return np.asarray(np.fmax(gains, gains.T))


def _backwards(square: Array) -> Array:
    return square[:, ::-1]
