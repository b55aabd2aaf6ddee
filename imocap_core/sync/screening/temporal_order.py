"""Temporal order: whether two videos follow the same order of time, beyond similar single poses.

A free warp finds similar poses in almost any two videos. Similar windows of motion are rarer by
chance: the poses of about 0.8 s, aligned by one rotation. Where the other video's time runs
backwards or begins elsewhere, a video of the same action fits clearly worse, and one of another
action as well as before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.rigid_alignment import centred
from imocap_core.sync.screening.warp_residual import (
    PairArrays,
    PairNumbers,
    expected_squares,
    warp_residuals,
)

OFFSETS_S = (-0.4, -0.2, 0.0, 0.2, 0.4)


def motion_windows(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    fps: Sequence[float],
) -> tuple[list[Float[np.ndarray, "_T 5*J 3"]], list[Float[np.ndarray, "_T 5*J"]]]:
    """Each frame with its neighbours as one pose of 5 J points, every pose about its centroid, and
    their weights; before the first frame and after the last one these are repeated."""
    windows, window_weights = [], []
    for x, w, f in zip(poses, weights, fps, strict=True):
        about = centred(x, w)
        rows = [np.clip(np.arange(len(x)) + round(s * f), 0, len(x) - 1) for s in OFFSETS_S]
        windows.append(np.concatenate([about[k] for k in rows], axis=1))
        window_weights.append(np.concatenate([w[k] for k in rows], axis=1))
    return windows, window_weights


def begun(share: float) -> Callable[[np.ndarray], np.ndarray]:
    """Squares (N, S) with the second video begun at another moment, its beginning last."""
    return lambda square: np.roll(square, round(share * square.shape[1]), axis=1)


def order_gains(
    squares: PairArrays, fps: Sequence[float], typical: PairNumbers, max_rate: float
) -> Float[np.ndarray, "M M"]:
    """How much better two videos fit in their order of time than out of it, symmetric.

    The logarithm of the mean warp residual with one of them run backwards or begun at another
    moment, over the warp residual; the better of the two directions. About 0 for a video of
    another action. Arguments as of `expected_squares`, squares of motion windows.
    """
    residuals, *scrambled = (
        warp_residuals(expected_squares(squares, fps, typical, max_rate, change), len(fps))
        for change in (None, _backwards, begun(1 / 3), begun(1 / 2), begun(2 / 3))
    )
    gains = np.log(np.mean(scrambled, axis=0) / np.maximum(residuals, 1e-12))
    return np.asarray(np.fmax(gains, gains.T))


def _backwards(square: np.ndarray) -> np.ndarray:
    return square[:, ::-1]
