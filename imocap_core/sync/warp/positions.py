"""From a soft map to a warp: one position per frame, in order, with its confidence."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

Array = NDArray[np.float64]


def median_positions(maps: Array, per_frame: int = 1) -> Array:
    """The median of each row of a stochastic map (n, S), in frames, fractional: what minimises the
    mean error.

    Each column is taken as a bin one column wide; `per_frame` columns make a frame.
    """
    cumulative = np.cumsum(maps, axis=1) / np.maximum(maps.sum(axis=1, keepdims=True), 1e-300)
    bin_ = (cumulative >= 0.5).argmax(axis=1)[:, None]
    upper = np.take_along_axis(cumulative, bin_, 1)
    lower = np.where(bin_ > 0, np.take_along_axis(cumulative, np.maximum(bin_ - 1, 0), 1), 0.0)
    inside = (0.5 - lower) / np.maximum(upper - lower, 1e-12)
    position = bin_[:, 0] - 0.5 + inside[:, 0]
    return np.asarray(np.clip(position, 0.0, maps.shape[1] - 1.0) / per_frame)


def in_order(positions: Array, weights: Array) -> Array:
    """The nearest non-decreasing warp (weighted least squares); NaN stay NaN and separate
    nothing."""
    out = positions.copy()
    known = np.isfinite(positions)
    if known.any():
        out[known] = isotonic_regression(positions[known], weights=weights[known] + 1e-6).x
    return out


def mass_within(maps: Array, positions: Array, reach: float, per_frame: int = 1) -> Array:
    """P(the true position is within `reach` frames of `positions`), per row of a stochastic map
    (n, S)."""
    columns = np.arange(maps.shape[1]) / per_frame
    half = 0.5 / per_frame  # each column is a bin: count the part of it that lies within reach
    low = np.maximum(columns[None, :] - half, (positions - reach)[:, None])
    high = np.minimum(columns[None, :] + half, (positions + reach)[:, None])
    return np.asarray((maps * np.maximum(high - low, 0.0) * per_frame).sum(axis=1))
