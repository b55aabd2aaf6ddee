"""Calibration of claimed standard deviations and probabilities.

A normalised error is the root mean square of (error / claimed standard deviation): 1 when claims
are honest, above 1 when they are too small, below 1 when they are too large. Coverage says whether
the whole distribution is honest: the regions that claim to hold 50 % of the truth hold 50 %.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.special import chdtr

COVERAGE_LEVELS = np.linspace(0.1, 0.9, 9)


def total_sigma(covariance: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch"]:
    """Total standard deviation: the root of the trace of each covariance."""
    return np.asarray(np.sqrt(np.einsum("...ii->...", np.asarray(covariance, dtype=np.float64))))


def along_and_across(
    covariance: Float[np.ndarray, "... 3 3"], direction: Float[np.ndarray, "... 3"]
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Standard deviations along unit vectors, and across them (both directions together).

    The leading axes of covariances and directions broadcast.
    """
    C, u = (np.asarray(x, dtype=np.float64) for x in (covariance, direction))
    along2 = np.einsum("...i,...ij,...j->...", u, C, u)
    across2 = np.einsum("...ii->...", C) - along2
    along, across = np.sqrt(np.maximum(along2, 0)), np.sqrt(np.maximum(across2, 0))
    return np.asarray(along), np.asarray(across)


def normalised_error(error: Float[np.ndarray, "..."], sigma: Float[np.ndarray, "..."]) -> float:
    """Root mean square of error / sigma over the entries in which both are finite; NaN if none."""
    e, s = np.broadcast_arrays(np.asarray(error, float), np.asarray(sigma, float))
    valid = np.isfinite(e) & (s > 0)
    if not valid.any():
        return float("nan")
    return float(np.sqrt(np.mean((e[valid] / s[valid]) ** 2)))


def normalised_errors(
    error: Float[np.ndarray, "T J"], sigma: Float[np.ndarray, "T J"]
) -> Float[np.ndarray, " J"]:
    """The normalised error of each joint.

    Raises:
        ValueError: the two shapes differ or are not (T, J).
    """
    e, s = (np.asarray(x, dtype=np.float64) for x in (error, sigma))
    if e.shape != s.shape or e.ndim != 2:
        raise ValueError(f"error and sigma must both be (T, J), got {e.shape} and {s.shape}")
    return np.array([normalised_error(a, b) for a, b in zip(e.T, s.T, strict=True)])


def probability_content(
    error: Float[np.ndarray, "*batch 3"], covariance: Float[np.ndarray, "*batch 3 3"]
) -> Float[np.ndarray, "*batch"]:
    """Probability integral transform of errors under claimed Gaussians: the content of the
    ellipsoid that just reaches the error, uniform on [0, 1] when claims are calibrated; NaN where
    either is."""
    e, C = (np.asarray(x, dtype=np.float64) for x in (error, covariance))
    valid = np.isfinite(e).all(-1) & np.isfinite(C).all((-1, -2))
    square = np.full(valid.shape, np.nan)
    solved = np.linalg.solve(C[valid], e[valid][..., None])[..., 0]
    square[valid] = (e[valid] * solved).sum(-1)
    return np.asarray(chdtr(3, square))


def covered_share(content: Float[np.ndarray, "..."], level: float) -> float:
    """Share of the truth within the regions of this content; NaN without entries."""
    finite = content[np.isfinite(content)]
    return float(np.mean(finite <= level)) if len(finite) else float("nan")


def coverage_error(content: Float[np.ndarray, "..."]) -> float:
    """Expected calibration error of coverage: mean over COVERAGE_LEVELS of |share of the truth
    within the region - level| (Kuleshov et al. 2018)."""
    gaps = [abs(covered_share(content, level) - level) for level in COVERAGE_LEVELS]
    return float(np.mean(gaps))
