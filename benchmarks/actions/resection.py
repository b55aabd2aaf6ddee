"""Camera resection: intrinsics and pose of a camera from pairs of 3D points and their pixels.

A projective camera P (3, 4) is linear in the pairs (direct linear transform; Hartley and Zisserman,
Multiple View Geometry, 2nd ed., section 7.1). It is estimated from random samples (RANSAC), fitted
again to its inliers, decomposed into K, R, t, and refined under a robust cost with square pixels
and no skew. Lens distortion is not modelled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.linalg import rq
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from imocap_core.camera.projection import project

SAMPLE = 8  # pairs per trial: 6 suffice, more make the estimate more stable
TRIALS = 300
MIN_PAIRS = 50
MIN_INLIER_SHARE = 0.5


@dataclass(frozen=True)
class Resection:
    """Intrinsics K and pose R, t (camera from world) with the reprojection error of the pairs."""

    K: Float[np.ndarray, "3 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]
    median_px: float
    inlier_share: float
    ok: bool
    status: str


def resect(
    x_world: ArrayLike,
    xy_px: ArrayLike,
    rng: np.random.Generator,
    *,
    scale_px: float = 5.0,
    inlier_px: float = 20.0,
) -> Resection:
    """Intrinsics and pose of the camera that saw pairs of points; pairs with NaN are left out.

    Args:
        x_world: (N, 3) points in the world, metres. xy_px: (N, 2) their pixels.
        rng: of the random samples.
        scale_px: scale of the robust (Cauchy) cost. inlier_px: largest error of an inlier.

    Raises:
        ValueError: wrong shapes, or fewer than 50 pairs.
    """
    world, pixels = np.asarray(x_world, dtype=np.float64), np.asarray(xy_px, dtype=np.float64)
    if world.ndim != 2 or world.shape[1:] != (3,) or pixels.shape != (len(world), 2):
        raise ValueError(
            f"expected x_world (N, 3) and xy_px (N, 2), got {world.shape}, {pixels.shape}"
        )
    complete = np.isfinite(world).all(axis=1) & np.isfinite(pixels).all(axis=1)
    world, pixels = world[complete], pixels[complete]
    if len(world) < MIN_PAIRS:
        raise ValueError(f"x_world: expected at least {MIN_PAIRS} pairs, got {len(world)}")
    P = _best_of_samples(world, pixels, rng, inlier_px)
    near = _errors_px(P[None], world, pixels)[0] < inlier_px
    K, R, t = _split(_linear(world[near][None], pixels[near][None])[0] if near.sum() >= 6 else P)
    K, R, t = _refined(world, pixels, K, R, t, scale_px)
    error = np.linalg.norm(project(world, K, R, t) - pixels, axis=1)
    share, ahead = float((error < inlier_px).mean()), (world @ R.T + t)[:, 2] > 0
    ok = share >= MIN_INLIER_SHARE and bool(ahead.mean() > 0.99)
    status = "found" if ok else f"only {share:.0%} of the pairs agree with one camera"
    return Resection(K, R, t, float(np.median(error)), share, ok, status)


def _best_of_samples(
    world: Float[np.ndarray, "N 3"],
    pixels: Float[np.ndarray, "N 2"],
    rng: np.random.Generator,
    inlier_px: float,
) -> Float[np.ndarray, "3 4"]:
    rows = rng.integers(len(world), size=(TRIALS, SAMPLE))
    cameras = _linear(world[rows], pixels[rows])
    checked = rng.permutation(len(world))[:2000]
    errors = _errors_px(cameras, world[checked], pixels[checked])
    return cameras[int(np.minimum(errors, inlier_px).sum(axis=1).argmin())]


def _linear(
    world: Float[np.ndarray, "B N 3"], pixels: Float[np.ndarray, "B N 2"]
) -> Float[np.ndarray, "B 3 4"]:
    """P by direct linear transform of normalised pairs (mean 0, standard deviation 1)."""
    centre, middle = world.mean(1, keepdims=True), pixels.mean(1, keepdims=True)
    spread = np.maximum(np.std(world - centre, axis=(1, 2)), 1e-9)[:, None, None]
    width = np.maximum(np.std(pixels - middle, axis=(1, 2)), 1e-9)[:, None, None]
    x = np.concatenate([(world - centre) / spread, np.ones((*world.shape[:2], 1))], -1)
    u, v = np.moveaxis((pixels - middle) / width, -1, 0)
    zero = np.zeros_like(x)
    rows = np.concatenate(
        [
            np.concatenate([x, zero, -u[..., None] * x], -1),
            np.concatenate([zero, x, -v[..., None] * x], -1),
        ],
        axis=1,
    )
    _, vectors = np.linalg.eigh(np.swapaxes(rows, 1, 2) @ rows)
    P = vectors[..., 0].reshape(-1, 3, 4)
    to_pixels = np.zeros((len(P), 3, 3))
    to_pixels[:, [0, 1], [0, 1]] = width[:, 0]
    to_pixels[:, :2, 2], to_pixels[:, 2, 2] = middle[:, 0], 1.0
    from_world = np.zeros((len(P), 4, 4))
    from_world[:, [0, 1, 2], [0, 1, 2]] = 1 / spread[:, 0]
    from_world[:, :3, 3], from_world[:, 3, 3] = -centre[:, 0] / spread[:, 0], 1.0
    return to_pixels @ P @ from_world


def _errors_px(
    P: Float[np.ndarray, "B 3 4"], world: Float[np.ndarray, "N 3"], pixels: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "B N"]:
    """Reprojection errors of all pairs under each of B cameras."""
    homogeneous = world @ np.swapaxes(P[:, :, :3], 1, 2) + P[:, None, :, 3]
    depth = np.where(np.abs(homogeneous[..., 2:]) > 1e-12, homogeneous[..., 2:], 1e-12)
    return np.linalg.norm(homogeneous[..., :2] / depth - pixels, axis=-1)


def _split(
    P: Float[np.ndarray, "3 4"],
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """P up to its scale and sign, decomposed into K with square pixels, R and t."""
    P = P * np.sign(np.linalg.det(P[:, :3]))
    upper, R = rq(P[:, :3])
    signs = np.diag(np.sign(np.diag(upper)))
    upper, R = upper @ signs, signs @ R
    t = np.linalg.solve(upper, P[:, 3])
    K = upper / upper[2, 2]
    focal = np.sqrt(K[0, 0] * K[1, 1])
    square = np.array([[focal, 0, K[0, 2]], [0, focal, K[1, 2]], [0, 0, 1.0]])
    return square, np.asarray(R, np.float64), np.asarray(t, np.float64)


def _refined(
    world: np.ndarray,
    pixels: np.ndarray,
    K: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    scale_px: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Focal length, principal point, rotation and translation under a Cauchy cost."""

    def camera(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        focal = np.exp(x[0])
        intrinsic = np.array([[focal, 0, x[1]], [0, focal, x[2]], [0, 0, 1.0]])
        return intrinsic, Rotation.from_rotvec(x[3:6]).as_matrix() @ R, x[6:]

    def residual(x: np.ndarray) -> np.ndarray:
        intrinsic, rotation, translation = camera(x)
        x_cam = world @ rotation.T + translation
        flat = x_cam[:, :2] / np.maximum(x_cam[:, 2:], 1e-3)
        return ((flat * intrinsic[0, 0] + intrinsic[:2, 2]) - pixels).ravel()

    start = np.array([np.log(K[0, 0]), K[0, 2], K[1, 2], 0, 0, 0, *t])
    solved = least_squares(residual, start, loss="cauchy", f_scale=scale_px, x_scale="jac")
    return camera(solved.x)
