"""Positions of frames from a soft map: median, monotone order, confidence."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import isotonic_regression

from imocap_core.sync.pairwise.banded import BandedMap, whole_band


def median_positions(
    soft_map: Float[np.ndarray, "N S"] | BandedMap, per_frame: int = 1
) -> Float[np.ndarray, " N"]:
    """The median of each row of a stochastic map, in frames, fractional: it minimises the mean
    error.

    Each column is taken as a bin one column wide; `per_frame` columns make a frame.
    """
    banded = _as_banded(soft_map)
    position = np.zeros(banded.shape[0])
    for rows, columns, values in banded:
        position[rows] = columns.start + _medians(values)
    return np.asarray(np.clip(position, 0.0, banded.shape[1] - 1.0) / per_frame)


def _medians(soft_map: np.ndarray) -> np.ndarray:
    """Median column (N,) of each row."""
    cumulative = np.cumsum(soft_map, axis=1, dtype=float)
    cumulative /= np.maximum(soft_map.sum(axis=1, keepdims=True, dtype=float), 1e-300)
    bin_ = (cumulative >= 0.5).argmax(axis=1)[:, None]
    upper = np.take_along_axis(cumulative, bin_, 1)
    lower = np.where(bin_ > 0, np.take_along_axis(cumulative, np.maximum(bin_ - 1, 0), 1), 0.0)
    inside = (0.5 - lower) / np.maximum(upper - lower, 1e-12)
    return np.asarray(bin_[:, 0] - 0.5 + inside[:, 0])


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
    soft_map: Float[np.ndarray, "N S"] | BandedMap,
    positions: Float[np.ndarray, " N"],
    reach: float,
    per_frame: int = 1,
) -> Float[np.ndarray, " N"]:
    """P(the true position is within `reach` frames of `positions`), per row of a stochastic map."""
    banded = _as_banded(soft_map)
    mass, half = np.zeros(banded.shape[0]), 0.5 / per_frame  # each column is a bin
    for rows, columns, values in banded:
        bins = np.arange(columns.start, columns.stop) / per_frame
        low = np.maximum(bins - half, (positions[rows] - reach)[:, None])
        high = np.minimum(bins + half, (positions[rows] + reach)[:, None])
        # the part of the bin that lies within reach
        mass[rows] = (values * np.maximum(high - low, 0.0) * per_frame).sum(axis=1)
    return mass


def _as_banded(soft_map: np.ndarray | BandedMap) -> BandedMap:
    return soft_map if isinstance(soft_map, BandedMap) else whole_band(soft_map)
