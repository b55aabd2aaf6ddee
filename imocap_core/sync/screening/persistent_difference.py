"""Persistent pose difference of two videos, excluding slow rotation and noise.

The warp residual aligns every pose by its own rotation, which absorbs part of any difference, and
counts the noise of both videos. Here the rotation between two videos changes slowly, and a frame is
compared with the mean of its possible counterparts in the other video, in which that video's noise
is averaged out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.rigid_alignment import centred, rotations_onto
from imocap_core.sync.screening.warp_residual import PairArrays, warp_residuals

ROTATION_S = 1.0  # time over which an estimate's orientation error changes


def persistent_differences(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    maps: PairArrays,
    fps: Sequence[float],
    share: float,
) -> Float[np.ndarray, "M M"]:
    """Persistent difference of video i to video j in the unit of the poses, over the `share` of the
    frames that fit best; NaN where two videos share no joints, and on the diagonal.

    `maps` (T_i, T_j) of all i != j as of `soft_maps`.
    """
    squares = {
        (i, j): persistent_squares(
            poses[i], weights[i], poses[j], weights[j], soft_map, ROTATION_S * fps[i]
        )
        for (i, j), soft_map in maps.items()
    }
    valid = {pair: square[np.isfinite(square)] for pair, square in squares.items()}
    return warp_residuals(valid, len(poses), share=share)


def persistent_squares(
    poses: Float[np.ndarray, "N J 3"],
    weights: Float[np.ndarray, "N J"],
    others: Float[np.ndarray, "S J 3"],
    others_weights: Float[np.ndarray, "S J"],
    soft_map: Float[np.ndarray, "N S"],
    window: float,
) -> Float[np.ndarray, " N"]:
    """Mean squared joint distance of each frame to its mean counterpart, slowly rotated.

    `soft_map` with rows of sum 1, `window` in frames as in `rotations_onto`. NaN where no joint is
    shared.
    """
    S = len(others)
    visible = soft_map @ others_weights
    weighted = others_weights[..., None] * centred(others, others_weights)
    mean = (soft_map @ weighted.reshape(S, -1)).reshape(poses.shape)
    mean = mean / np.maximum(visible, 1e-12)[..., None]
    both = weights * visible
    x, y = centred(poses, both), centred(mean, both)
    R_other_from_video = rotations_onto(x, y, both, window)
    residual = x - np.einsum("nab,nja->njb", R_other_from_video, y)
    total = both.sum(axis=1)
    square = (both * (residual**2).sum(axis=-1)).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.where(total > 0, square, np.nan)
