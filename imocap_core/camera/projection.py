"""The pinhole camera: points to pixels, pixels to rays, homographies on pixels.

Camera axes are OpenCV's (x right, y down, z forward): ``x_cam = R_cam_from_world @ x_world + t``,
``K`` is 3x3 in pixels, there is no lens distortion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def intrinsics(focal_px: float, size: tuple[int, int]) -> Array:
    """K (3, 3) of square pixels, principal point in the middle of a (width, height) picture."""
    if not focal_px > 0:
        raise ValueError(f"focal_px: expected a positive number of pixels, got {focal_px}")
    width, height = size
    return np.array(
        [[focal_px, 0.0, (width - 1) / 2], [0.0, focal_px, (height - 1) / 2], [0.0, 0.0, 1.0]]
    )


def camera_from_world(x_world: Array, R_cam_from_world: Array, t: Array) -> Array:
    """Points (..., 3) of the world in camera axes, same unit as ``t``."""
    return x_world @ np.swapaxes(R_cam_from_world, -1, -2) + t


def project_camera(x_cam: Array, K: Array) -> Array:
    """Pixels (..., 2) of points (..., 3) in camera axes; NaN for points not in front of it."""
    depth = np.where(x_cam[..., 2:] > 0, x_cam[..., 2:], np.nan)
    return (x_cam / depth) @ K[:2].T


def project(x_world: Array, K: Array, R_cam_from_world: Array, t: Array) -> Array:
    """Pixels (..., 2) of world points (..., 3); NaN for points not in front of the camera."""
    return project_camera(camera_from_world(x_world, R_cam_from_world, t), K)


def normalised(xy_px: Array, K: Array) -> Array:
    """Pixels (..., 2) on the plane z = 1 of the camera: ``(x/z, y/z)``."""
    K_inverse = np.asarray(np.linalg.inv(K), dtype=np.float64)
    return warp(K_inverse, xy_px)


def rays(xy_px: Array, K: Array) -> Array:
    """Unit directions (..., 3) in camera axes through pixels (..., 2)."""
    plane = normalised(xy_px, K)
    direction = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
    return direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def warp(H_b_from_a: Array, xy_a: Array) -> Array:
    """Homography (..., 3, 3) applied to points (..., 2); both broadcast, NaN stays NaN."""
    homogeneous = np.concatenate([xy_a, np.ones_like(xy_a[..., :1])], axis=-1)
    moved = np.einsum("...ij,...j->...i", H_b_from_a, homogeneous)
    return moved[..., :2] / moved[..., 2:]
