"""How far do two videos differ for good? What neither a turn of every frame nor noise can change.

`levels` turns every pose by itself, which takes up part of any difference, and counts the noise of
both videos. Here the turn between two videos changes slowly, and a frame is held against the mean
of where it may lie in the other video, in which that video's noise has gone.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.pairwise.view_axes import centred, rotations_onto
from imocap_core.sync.screening.warp_residual import PairSquares, matched_levels

Array = NDArray[np.float64]

TURNING_S = 1.0  # an estimate's orientation error changes over about this long


def steady_levels(
    poses: Sequence[Array],
    weights: Sequence[Array],
    maps: PairSquares,
    fps: Sequence[float],
    share: float,
) -> Array:
    """Level (M, M) of video i in video j in the unit of the poses, over the `share` of the frames
    that fit best; NaN where two videos share no joints, and on the diagonal.

    `poses` (T_v, J, 3), `weights` (T_v, J), `maps` (T_i, T_j) of all i != j as of `soft_maps`.
    """
    squares = {
        (i, j): steady_squares(poses[i], weights[i], poses[j], weights[j], soft, TURNING_S * fps[i])
        for (i, j), soft in maps.items()
    }
    known = {pair: square[np.isfinite(square)] for pair, square in squares.items()}
    return matched_levels(known, len(poses), share=share)


def steady_squares(
    poses: Array, weights: Array, others: Array, others_weights: Array, maps: Array, window: float
) -> Array:
    """Mean squared joint distance (n,) of each frame to its mean counterpart, turned slowly.

    `poses` (n, J, 3), `others` (S, J, 3), their weights (n, J) and (S, J), `maps` (n, S) with rows
    of sum 1, `window` in frames as in `rotations_onto`. NaN where no joint is shared.
    """
    S = len(others)
    seen = maps @ others_weights
    pulled = others_weights[..., None] * centred(others, others_weights)
    mean = (maps @ pulled.reshape(S, -1)).reshape(poses.shape) / np.maximum(seen, 1e-12)[..., None]
    both = weights * seen
    x, y = centred(poses, both), centred(mean, both)
    R_other_from_own = rotations_onto(x, y, both, window)
    left = x - np.einsum("nab,nja->njb", R_other_from_own, y)
    total = both.sum(axis=1)
    square = (both * (left**2).sum(axis=-1)).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.where(total > 0, square, np.nan)
