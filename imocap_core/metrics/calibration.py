"""Whether claimed standard deviations are honest: errors in units of what was claimed.

A normalised error is the root mean square of (error / claimed standard deviation): 1 when claims
are honest, above 1 when they are too small, below 1 when they are too large.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def total_sigma(covariance: ArrayLike) -> Array:
    """(...) root of the trace of covariances (..., 3, 3)."""
    spread: Array = np.sqrt(np.einsum("...ii->...", np.asarray(covariance, dtype=np.float64)))
    return spread


def along_and_across(covariance: ArrayLike, direction: ArrayLike) -> tuple[Array, Array]:
    """Standard deviations (...) along unit vectors (..., 3), and across them (both directions
    together), of covariances (..., 3, 3)."""
    C, u = (np.asarray(x, dtype=np.float64) for x in (covariance, direction))
    along2 = np.einsum("...i,...ij,...j->...", u, C, u)
    across2 = np.einsum("...ii->...", C) - along2
    return np.sqrt(np.maximum(along2, 0)), np.sqrt(np.maximum(across2, 0))


def normalised_error(error: ArrayLike, sigma: ArrayLike) -> float:
    """Root mean square of error / sigma over every entry in which both are known; NaN without."""
    e, s = np.broadcast_arrays(np.asarray(error, float), np.asarray(sigma, float))
    known = np.isfinite(e) & (s > 0)
    if not known.any():
        return float("nan")
    return float(np.sqrt(np.mean((e[known] / s[known]) ** 2)))


def normalised_errors(error: ArrayLike, sigma: ArrayLike) -> Array:
    """(J,) the same for each joint of errors (T, J) and standard deviations (T, J)."""
    e, s = (np.asarray(x, dtype=np.float64) for x in (error, sigma))
    if e.shape != s.shape or e.ndim != 2:
        raise ValueError(f"error and sigma must both be (T, J), got {e.shape} and {s.shape}")
    return np.array([normalised_error(a, b) for a, b in zip(e.T, s.T, strict=True)])
