"""Robust averaging of rotations and of vectors: one camera pose from many noisy estimates of it.

Each pair of matched frames gives one estimate of a camera's rotation relative to the reference
camera, the difference of two root orientations. Many of these are wrong (mismatched frames, flipped
monocular fits), so the mean has to ignore outliers.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from imocap_core.robust import geman_mcclure_weight

ITERATIONS = 50


def nearest_rotation(M: Float[np.ndarray, "... 3 3"]) -> Float[np.ndarray, "... 3 3"]:
    """Nearest rotations to any matrices, in the Frobenius norm (Kabsch 1976)."""
    U, _, Vt = np.linalg.svd(M)
    sign = np.linalg.det(U @ Vt)
    U = U.copy()
    U[..., :, 2] *= sign[..., None]
    return U @ Vt


def angle_deg(
    R_a: Float[np.ndarray, "... 3 3"], R_b: Float[np.ndarray, "... 3 3"]
) -> Float[np.ndarray, "..."]:
    """Geodesic distance between rotations, degrees; accurate near 0 and near 180."""
    relative = np.swapaxes(R_a, -1, -2) @ R_b
    shape = relative.shape[:-2]
    angles = Rotation.from_matrix(relative.reshape(-1, 3, 3)).magnitude()
    return np.rad2deg(angles).reshape(shape)


def mean_rotation(
    R: ArrayLike, weights: ArrayLike | None = None, *, scale_deg: float = 10.0
) -> Float[np.ndarray, "3 3"]:
    """Robust single rotation averaging: Geman-McClure mean of rotations (N, 3, 3).

    Starts at the projected entrywise median (Lee and Civera, "Robust single rotation averaging",
    2020), then reweights chordal means. The scale starts at the median angle and shrinks to
    ``scale_deg``: a wide basin of attraction first. Rotations with NaN have no weight.

    Args:
        R: (N, 3, 3) rotations, NaN where missing.
        weights: (N,) prior weights, or None for equal ones.
        scale_deg: Geman-McClure scale, degrees.

    Returns:
        The mean; the identity where no rotation counts.

    Raises:
        ValueError: wrong shapes.
    """
    R = np.asarray(R, dtype=np.float64)
    if R.ndim != 3 or R.shape[1:] != (3, 3):
        raise ValueError(f"R: expected rotations of shape (N, 3, 3), got {R.shape}")
    prior, valid = _prior(weights, np.isfinite(R.sum(axis=(1, 2))))
    if not valid.any():
        return np.eye(3)
    used, share = R[valid], prior[valid]
    mean = nearest_rotation(_weighted_median(used, share))
    scale = max(scale_deg, float(np.median(angle_deg(used, mean))))
    for _ in range(ITERATIONS):
        robust = share * geman_mcclure_weight(angle_deg(used, mean), scale)
        new = nearest_rotation(np.einsum("n,nij->ij", robust, used))
        moved = float(angle_deg(mean, new))
        mean = new
        if moved < 1e-6 and scale == scale_deg:
            break
        scale = max(scale_deg, 0.7 * scale)
    return mean


def mean_vector(
    x: ArrayLike, weights: ArrayLike | None = None, *, scale: float
) -> Float[np.ndarray, " D"]:
    """Geman-McClure mean of vectors (N, D).

    Starts at the coordinatewise median and shrinks the scale like `mean_rotation`.

    Args:
        x: (N, D) vectors, NaN where missing.
        weights: (N,) prior weights, or None for equal ones.
        scale: Geman-McClure scale, in the unit of the vectors.

    Returns:
        The mean; 0 where no vector counts.

    Raises:
        ValueError: wrong shapes.
    """
    x = np.asarray(x, dtype=np.float64)
    if x.ndim != 2:
        raise ValueError(f"x: expected vectors of shape (N, D), got {x.shape}")
    prior, valid = _prior(weights, np.isfinite(x.sum(axis=1)))
    if not valid.any():
        return np.zeros(x.shape[1])
    used, share = x[valid], prior[valid]
    mean = _weighted_median(used, share)
    width = max(scale, float(np.median(np.linalg.norm(used - mean, axis=1))))
    for _ in range(ITERATIONS):
        robust = share * geman_mcclure_weight(np.linalg.norm(used - mean, axis=1), width)
        new = (robust @ used) / robust.sum()
        moved = float(np.linalg.norm(new - mean))
        mean = new
        if moved < 1e-9 * max(1.0, scale) and width == scale:
            break
        width = max(scale, 0.7 * width)
    return mean


def _prior(
    weights: ArrayLike | None, finite: Bool[np.ndarray, " N"]
) -> tuple[Float[np.ndarray, " N"], Bool[np.ndarray, " N"]]:
    """Given weights or ones, and which entries have both a value and a positive weight."""
    prior = np.ones(len(finite)) if weights is None else np.asarray(weights, dtype=np.float64)
    if prior.shape != finite.shape:
        raise ValueError(f"weights: expected shape {finite.shape}, got {prior.shape}")
    return prior, finite & (prior > 0)


def _weighted_median(
    values: Float[np.ndarray, "N *item"], weights: Float[np.ndarray, " N"]
) -> Float[np.ndarray, "*item"]:
    """Lower weighted median over the first axis, entry by entry."""
    flat = values.reshape(len(values), -1)
    order = np.argsort(flat, axis=0, kind="stable")
    cumulated = np.cumsum(weights[order], axis=0)
    row = np.argmax(cumulated >= 0.5 * cumulated[-1], axis=0)
    median = np.take_along_axis(flat, order, axis=0)[row, np.arange(flat.shape[1])]
    return median.reshape(values.shape[1:])
