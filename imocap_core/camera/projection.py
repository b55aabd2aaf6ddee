"""The pinhole camera: points to pixels, pixels to rays, homographies on pixels.

Camera axes are OpenCV's (x right, y down, z forward): ``x_cam = R_cam_from_world @ x_world + t``,
``K`` is 3x3 in pixels, there is no lens distortion.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def intrinsics(focal_px: float, size: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
    """Intrinsic matrix K of square pixels, principal point in the middle of the picture.

    Args:
        focal_px: focal length in pixels. size: (width, height) of the picture.

    Raises:
        ValueError: the focal length is not positive.
    """
    if not focal_px > 0:
        raise ValueError(f"focal_px: expected a positive number of pixels, got {focal_px}")
    width, height = size
    return np.array(
        [[focal_px, 0.0, (width - 1) / 2], [0.0, focal_px, (height - 1) / 2], [0.0, 0.0, 1.0]]
    )


def camera_from_world(
    x_world: Float[np.ndarray, "... 3"],
    R_cam_from_world: Float[np.ndarray, "... 3 3"],
    t: Float[np.ndarray, "... 3"],
) -> Float[np.ndarray, "... 3"]:
    """World points in camera axes, in the unit of ``t``."""
    return x_world @ np.swapaxes(R_cam_from_world, -1, -2) + t


def project_camera(
    x_cam: Float[np.ndarray, "... 3"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "... 2"]:
    """Perspective projection of points in camera axes to pixels; NaN behind the camera."""
    depth = np.where(x_cam[..., 2:] > 0, x_cam[..., 2:], np.nan)
    return (x_cam / depth) @ K[:2].T


def project(
    x_world: Float[np.ndarray, "... 3"],
    K: Float[np.ndarray, "3 3"],
    R_cam_from_world: Float[np.ndarray, "... 3 3"],
    t: Float[np.ndarray, "... 3"],
) -> Float[np.ndarray, "... 2"]:
    """Perspective projection of world points to pixels; NaN behind the camera."""
    return project_camera(camera_from_world(x_world, R_cam_from_world, t), K)


def normalised(
    xy_px: Float[np.ndarray, "... 2"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "... 2"]:
    """Normalised image coordinates ``(x/z, y/z)`` of pixels."""
    K_inverse = np.asarray(np.linalg.inv(K), dtype=np.float64)
    return warp(K_inverse, xy_px)


def rays(
    xy_px: Float[np.ndarray, "... 2"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "... 3"]:
    """Unit direction vectors through pixels, in camera axes."""
    plane = normalised(xy_px, K)
    direction = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
    return direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def warp(
    H_b_from_a: Float[np.ndarray, "... 3 3"], xy_a: Float[np.ndarray, "... 2"]
) -> Float[np.ndarray, "... 2"]:
    """Homographies applied to points; both broadcast, NaN stays NaN."""
    homogeneous = np.concatenate([xy_a, np.ones_like(xy_a[..., :1])], axis=-1)
    moved = np.einsum("...ij,...j->...i", H_b_from_a, homogeneous)
    return moved[..., :2] / moved[..., 2:]
