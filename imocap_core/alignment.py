"""Procrustes alignment of point sets, weighted, batched; a rotation at a local minimum.

Points that are NaN in either set, or whose weight is zero, are ignored. Directions are in the
names: ``R_target_from_source`` rotates vectors from the axes of ``source`` to those of ``target``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

MIN_POINTS = 3
"""Fewer points than this leave a rotation undetermined; such an alignment is all NaN."""


@dataclass(frozen=True)
class Alignment:
    """A similarity (or, with ``scale`` 1, rigid) transform, with any leading axes.

    ``x_target = scale * R_target_from_source @ x_source + t_target``.
    """

    R_target_from_source: Float[np.ndarray, "*batch 3 3"]
    t_target: Float[np.ndarray, "*batch 3"]  # units of the points
    scale: Float[np.ndarray, "*batch"]

    def apply(self, points: ArrayLike) -> Float[np.ndarray, "... N 3"]:
        """Points (..., N, 3) of the source, in the axes of the target."""
        x = np.asarray(points, dtype=np.float64)
        rotated = x @ np.swapaxes(self.R_target_from_source, -1, -2)
        return self.scale[..., None, None] * rotated + self.t_target[..., None, :]


def procrustes(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None, *, scale: bool = False
) -> Alignment:
    """Least-squares alignment of ``source`` onto ``target`` (Kabsch 1976, Umeyama 1991).

    Args:
        source, target: (..., N, 3) points; leading axes broadcast.
        weights: (..., N) non-negative, or None for equal weights.
        scale: also solve a positive scale (similarity); otherwise the scale is 1 (rigid).

    Returns:
        Alignment over the leading axes; NaN where fewer than three points are usable. Collinear
        points do not determine the rotation about their line: one of the optimal rotations is
        returned.

    Raises:
        ValueError: last axis not 3, different numbers of points, or a negative weight.
    """
    x, y, w = _usable(source, target, weights)
    total = w.sum(axis=-1)
    enough = (w > 0).sum(axis=-1) >= MIN_POINTS
    unit = w / np.where(total > 0, total, 1.0)[..., None]

    mean_x = (unit[..., None, :] @ x)[..., 0, :]
    mean_y = (unit[..., None, :] @ y)[..., 0, :]
    x = x - mean_x[..., None, :]
    y = y - mean_y[..., None, :]
    weighted = np.swapaxes(unit[..., None] * x, -1, -2)
    covariance = np.swapaxes(weighted @ y, -1, -2)
    U, singular, Vt = np.linalg.svd(covariance)
    sign = np.ones_like(singular)
    sign[..., 2] = np.where(np.linalg.det(U) * np.linalg.det(Vt) < 0, -1.0, 1.0)
    R = (U * sign[..., None, :]) @ Vt
    s = np.ones(total.shape)
    if scale:
        spread = np.trace(weighted @ x, axis1=-2, axis2=-1)
        s = (singular * sign).sum(axis=-1) / np.where(spread > 0, spread, np.nan)
    t = mean_y - s[..., None] * np.einsum("...rc,...c->...r", R, mean_x)
    return Alignment(
        np.where(enough[..., None, None], R, np.nan),
        np.where(enough[..., None], t, np.nan),
        np.where(enough, s, np.nan),
    )


def rigid(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None) -> Alignment:
    """Best rotation and translation of ``source`` onto ``target``; see `procrustes`."""
    return procrustes(source, target, weights, scale=False)


def similarity(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None) -> Alignment:
    """Best rotation, translation and scale of ``source`` onto ``target``; see `procrustes`."""
    return procrustes(source, target, weights, scale=True)


def _usable(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None
) -> tuple[
    Float[np.ndarray, "*batch N 3"], Float[np.ndarray, "*batch N 3"], Float[np.ndarray, "*batch N"]
]:
    """Both point sets with zeros for NaN, and weights that are zero there."""
    x, y = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if x.shape[-1:] != (3,) or y.shape[-1:] != (3,) or x.shape[-2:] != y.shape[-2:]:
        raise ValueError(f"points must be (..., N, 3) with one N, got {x.shape} and {y.shape}")
    x, y = np.broadcast_arrays(x, y)
    if weights is None and np.isfinite(x).all() and np.isfinite(y).all():
        return x, y, np.ones(x.shape[:-1])
    usable = np.asarray(np.isfinite(x).all(axis=-1) & np.isfinite(y).all(axis=-1))
    w = np.ones(usable.shape) if weights is None else np.broadcast_to(weights, usable.shape)
    w = np.where(usable & np.isfinite(w), w, 0.0)
    if (w < 0).any():
        raise ValueError(f"weights must not be negative, got {w.min()}")
    return np.where(usable[..., None], x, 0.0), np.where(usable[..., None], y, 0.0), w


LEAST_GAIN = 1e-9


def refined_rotation(
    R: Float[np.ndarray, "3 3"],
    residuals: Callable[[Float[np.ndarray, "D 3 3"]], Float[np.ndarray, " D"]],
    steps_deg: Sequence[float],
) -> tuple[Float[np.ndarray, "3 3"], float]:
    """The rotation to which turns about the six half axes lead, and its residual.

    Args:
        residuals: of some rotations at once. steps_deg: angles of the turns, one after another.
    """
    least = float(residuals(R[None])[0])
    for step_deg in steps_deg:
        vectors = np.concatenate([np.eye(3), -np.eye(3)]) * np.deg2rad(step_deg)
        turns = Rotation.from_rotvec(vectors).as_matrix()
        while True:
            near = turns @ R
            values = residuals(near)
            if values.min() >= least - LEAST_GAIN:
                break
            R, least = near[values.argmin()], float(values.min())
    return R, least
