"""A camera, inside and out, from points whose 3D places and pixels are known (resection).

A projective camera P (3, 4) is linear in the pairs (direct linear transform; Hartley and Zisserman,
Multiple View Geometry, 2nd ed., section 7.1). It is found on random samples, kept by its inliers,
split into K, R, t, and refined under a robust cost with square pixels and no skew. Lens distortion
is not modelled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import rq
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from imocap_core.camera.projection import project

Array = NDArray[np.float64]

SAMPLE = 8  # pairs a trial: 6 are enough, more make it steadier
TRIALS = 300
MIN_PAIRS = 50
MIN_INLIER_SHARE = 0.5


@dataclass(frozen=True)
class Resection:
    """K (3, 3), R (3, 3), t (3,) camera from world; how well it explains the pairs."""

    K: Array
    R: Array
    t: Array
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
    """The camera of pairs x_world (N, 3), xy_px (N, 2); pairs with NaN are left out.

    Args:
        scale_px: where the robust cost begins to flatten. inlier_px: what still counts as seen.

    Raises:
        ValueError: shapes, or fewer than 50 pairs.
    """
    world, pixels = np.asarray(x_world, dtype=np.float64), np.asarray(xy_px, dtype=np.float64)
    if world.ndim != 2 or world.shape[1:] != (3,) or pixels.shape != (len(world), 2):
        raise ValueError(
            f"expected x_world (N, 3) and xy_px (N, 2), got {world.shape}, {pixels.shape}"
        )
    seen = np.isfinite(world).all(axis=1) & np.isfinite(pixels).all(axis=1)
    world, pixels = world[seen], pixels[seen]
    if len(world) < MIN_PAIRS:
        raise ValueError(f"x_world: expected at least {MIN_PAIRS} pairs, got {len(world)}")
    P = _best_of_samples(world, pixels, rng, inlier_px)
    near = _errors_px(P[None], world, pixels)[0] < inlier_px
    K, R, t = _split(_linear(world[near][None], pixels[near][None])[0] if near.sum() >= 6 else P)
    K, R, t = _refined(world, pixels, K, R, t, scale_px)
    error = np.linalg.norm(project(world, K, R, t) - pixels, axis=1)
    share, ahead = float((error < inlier_px).mean()), (world @ R.T + t)[:, 2] > 0
    ok = share >= MIN_INLIER_SHARE and bool(ahead.mean() > 0.99)
    said = "found" if ok else f"only {share:.0%} of the pairs agree with one camera"
    return Resection(K, R, t, float(np.median(error)), share, ok, said)


def _best_of_samples(
    world: Array, pixels: Array, rng: np.random.Generator, inlier_px: float
) -> Array:
    rows = rng.integers(len(world), size=(TRIALS, SAMPLE))
    cameras = _linear(world[rows], pixels[rows])
    checked = rng.permutation(len(world))[:2000]
    errors = _errors_px(cameras, world[checked], pixels[checked])
    best: Array = cameras[int(np.minimum(errors, inlier_px).sum(axis=1).argmin())]
    return best


def _linear(world: Array, pixels: Array) -> Array:
    """P (B, 3, 4) of pairs (B, N, 3), (B, N, 2), both brought to a mean of 0 and a spread of 1."""
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
    found: Array = to_pixels @ P @ from_world
    return found


def _errors_px(P: Array, world: Array, pixels: Array) -> Array:
    """(B, N) distances of projections of world (N, 3) by P (B, 3, 4) to pixels (N, 2)."""
    seen = world @ np.swapaxes(P[:, :, :3], 1, 2) + P[:, None, :, 3]
    depth = np.where(np.abs(seen[..., 2:]) > 1e-12, seen[..., 2:], 1e-12)
    error: Array = np.linalg.norm(seen[..., :2] / depth - pixels, axis=-1)
    return error


def _split(P: Array) -> tuple[Array, Array, Array]:
    """K with square pixels, R and t of P up to its scale and sign."""
    P = P * np.sign(np.linalg.det(P[:, :3]))
    upper, R = rq(P[:, :3])
    signs = np.diag(np.sign(np.diag(upper)))
    upper, R = upper @ signs, signs @ R
    t = np.linalg.solve(upper, P[:, 3])
    K = upper / upper[2, 2]
    focal = np.sqrt(K[0, 0] * K[1, 1])
    square: Array = np.array([[focal, 0, K[0, 2]], [0, focal, K[1, 2]], [0, 0, 1.0]])
    return square, np.asarray(R, np.float64), np.asarray(t, np.float64)


def _refined(
    world: Array, pixels: Array, K: Array, R: Array, t: Array, scale_px: float
) -> tuple[Array, Array, Array]:
    """Focal length, principal point, turn and shift under a Cauchy cost."""

    def camera(x: Array) -> tuple[Array, Array, Array]:
        focal = np.exp(x[0])
        inside = np.array([[focal, 0, x[1]], [0, focal, x[2]], [0, 0, 1.0]])
        return inside, Rotation.from_rotvec(x[3:6]).as_matrix() @ R, x[6:]

    def residual(x: Array) -> Array:
        inside, turn, shift = camera(x)
        seen = world @ turn.T + shift
        flat = seen[:, :2] / np.maximum(seen[:, 2:], 1e-3)
        return ((flat * inside[0, 0] + inside[:2, 2]) - pixels).ravel()

    start = np.array([np.log(K[0, 0]), K[0, 2], K[1, 2], 0, 0, 0, *t])
    solved = least_squares(residual, start, loss="cauchy", f_scale=scale_px, x_scale="jac")
    return camera(solved.x)
