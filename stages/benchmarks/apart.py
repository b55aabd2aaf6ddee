"""Where performers stand when several performances share poses but not paths.

For the oracle every video's path may depart from the common one by a shift at every frame, with a
spread that the images themselves tell (expectation maximisation): nearly none where all videos film
one motion, half a metre where they do not. The common path is where all videos together see it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEPS = 4  # of Gauss-Newton
ROUNDS = 6  # of expectation maximisation
FIRST_M, LEAST_M = 0.3, 0.003
HOLD = 1.0  # 1/m^2, of the common path to where it was
NEAREST_M = 0.05


def pixels_of(points_m: Array, K: Array) -> Array:
    """(N, J, 2) projections of points (N, J, 3) in camera axes."""
    depth = np.maximum(points_m[..., 2:], NEAREST_M)
    return np.asarray(points_m[..., :2] / depth * np.diag(K)[:2] + K[:2, 2])


def common_and_own(
    points_m: Array, R: Array, xy_px: Array, weight: Array, K: Array, start_m: Array, scale: float
) -> tuple[Array, Array]:
    """How the common path moves, (N, 3) in the world, and each video's shift from it then,
    (M, N, 3) in its camera's axes, so that the keypoints are explained best.

    Args:
        points_m: (M, N, J, 3) of the common motion in each camera's axes. R: (M, 3, 3) camera from
            world. xy_px: (M, N, J, 2); weight: (M, N, J) 1/px^2, 0 where unseen. K: (M, 3, 3).
        start_m: (M, N, 3) rough shifts, camera axes.
        scale: of the Geman-McClure cost, in standard deviations.

    Where a video shows nothing its shift is zero; where none shows anything the path stays.
    """
    at, sigma = start_m.copy(), FIRST_M
    shift, common = np.zeros_like(at), np.zeros_like(at[0])
    for _ in range(ROUNDS):
        prior = np.eye(3) / sigma**2
        for _ in range(STEPS):
            H, h = _information(points_m + at[:, :, None], at, xy_px, weight, K, scale)
            seen = np.linalg.inv(H + prior)
            marginal, told = H - H @ seen @ H, h - H @ seen @ h
            total = np.einsum("mji,mnjk,mkl->nil", R, marginal, R) + HOLD * np.eye(3)
            common = np.linalg.solve(total, np.einsum("mji,mnja->nia", R, told))[..., 0]
            there = np.einsum("mij,nj->mni", R, common)[..., None]
            shift = (seen @ (h - H @ there))[..., 0]
            at = there[..., 0] + shift
        square = (shift**2).sum(-1) + np.trace(seen, axis1=2, axis2=3)
        known = (weight > 0).any(axis=-1)
        sigma = max(float(np.sqrt(square[known].mean() / 3)), LEAST_M)
    return common, shift


def _information(
    points_m: Array, at: Array, xy_px: Array, weight: Array, K: Array, scale: float
) -> tuple[Array, Array]:
    """Precision (M, N, 3, 3) and precision times mean (M, N, 3, 1) of where each performer is."""
    H, h = np.zeros((*at.shape, 3)), np.zeros((*at.shape, 1))
    for v in range(len(at)):
        error = pixels_of(points_m[v], K[v]) - xy_px[v]
        sure = weight[v] / (1 + weight[v] * (error**2).sum(-1) / scale**2) ** 2
        J = _by_shift(points_m[v], K[v])
        H[v] = np.einsum("nj,njai,njab->nib", sure, J, J)
        pull = np.einsum("nj,njai,nja->ni", sure, J, error)
        h[v] = H[v] @ at[v][..., None] - pull[..., None]
    return H, h


def as_if_together(points_m: Array, xy_px: Array, K: Array, shift_m: Array) -> Array:
    """Keypoints (N, J, 2) as they would lie if the performer stood where the common one does."""
    moved = pixels_of(points_m + shift_m[:, None], K) - pixels_of(points_m, K)
    return np.asarray(xy_px - moved)


def _by_shift(points_m: Array, K: Array) -> Array:
    """(N, J, 2, 3) derivative of the pixels by a shift."""
    depth = np.maximum(points_m[..., 2], NEAREST_M)
    rows = np.zeros((*depth.shape, 2, 3))
    for axis in (0, 1):
        rows[..., axis, axis] = K[axis, axis] / depth
        rows[..., axis, 2] = -K[axis, axis] * points_m[..., axis] / depth**2
    return rows
