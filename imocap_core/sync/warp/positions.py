"""Positions of frames from a soft map: median, monotone order, confidence."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import isotonic_regression


def median_positions(
    soft_map: Float[np.ndarray, "N S"], per_frame: int = 1
) -> Float[np.ndarray, " N"]:
    """The median of each row of a stochastic map, in frames, fractional: it minimises the mean
    error.

    Each column is taken as a bin one column wide; `per_frame` columns make a frame.
    """
    cumulative = np.cumsum(soft_map, axis=1) / np.maximum(
        soft_map.sum(axis=1, keepdims=True), 1e-300
    )
    bin_ = (cumulative >= 0.5).argmax(axis=1)[:, None]
    upper = np.take_along_axis(cumulative, bin_, 1)
    lower = np.where(bin_ > 0, np.take_along_axis(cumulative, np.maximum(bin_ - 1, 0), 1), 0.0)
    inside = (0.5 - lower) / np.maximum(upper - lower, 1e-12)
    position = bin_[:, 0] - 0.5 + inside[:, 0]
    return np.asarray(np.clip(position, 0.0, soft_map.shape[1] - 1.0) / per_frame)


def isotonic(
    positions: Float[np.ndarray, " N"], weights: Float[np.ndarray, " N"]
) -> Float[np.ndarray, " N"]:
    """The nearest non-decreasing warp (weighted least squares); NaN stay NaN and separate
    nothing."""
    out = positions.copy()
    matched = np.isfinite(positions)
    if matched.any():
        out[matched] = isotonic_regression(positions[matched], weights=weights[matched] + 1e-6).x
    return out


def mass_within(
    soft_map: Float[np.ndarray, "N S"],
    positions: Float[np.ndarray, " N"],
    reach: float,
    per_frame: int = 1,
) -> Float[np.ndarray, " N"]:
    """P(the true position is within `reach` frames of `positions`), per row of a stochastic map."""
    columns = np.arange(soft_map.shape[1]) / per_frame
    half = 0.5 / per_frame  # each column is a bin: count the part of it that lies within reach
    low = np.maximum(columns[None, :] - half, (positions - reach)[:, None])
    high = np.minimum(columns[None, :] + half, (positions + reach)[:, None])
    return np.asarray((soft_map * np.maximum(high - low, 0.0) * per_frame).sum(axis=1))
