"""Errors of what a camera sees and of where it looks."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def camera_rotation_error_deg(
    R_cam_from_world: ArrayLike,
    R_ref_from_world: ArrayLike,
    R_cam_from_true_world: ArrayLike,
    R_ref_from_true_world: ArrayLike,
) -> Array:
    """Angle (...,) between the recovered and the true turn from reference to other camera.

    The recovered world is the reference camera's axes and the true world is anything, so only the
    relative rotation ``R_cam_from_ref = R_cam_from_world @ R_ref_from_world.T`` can be compared.
    All arguments (..., 3, 3), broadcasting.
    """
    found = _relative(R_cam_from_world, R_ref_from_world)
    true = _relative(R_cam_from_true_world, R_ref_from_true_world)
    return rotation_angle_deg(found @ np.swapaxes(true, -1, -2))


def rotation_angle_deg(R: ArrayLike) -> Array:
    """Angle of rotation matrices (..., 3, 3), in degrees, 0 to 180."""
    matrices = np.asarray(R, dtype=np.float64)
    angles = Rotation.from_matrix(matrices.reshape(-1, 3, 3)).magnitude()
    return np.degrees(np.asarray(angles)).reshape(matrices.shape[:-2])


def reprojection_errors_px(
    points_cam_m: ArrayLike, K: ArrayLike, xy_px: ArrayLike, confidence: ArrayLike
) -> Array:
    """Distance (T, J) of projected points to the keypoints seen, NaN where unseen or behind.

    Args:
        points_cam_m: (T, J, 3) in camera axes. K: (3, 3). xy_px: (T, J, 2).
        confidence: (T, J); a keypoint with confidence 0 was not seen.
    """
    points = np.asarray(points_cam_m, dtype=np.float64)
    seen, trust = np.asarray(xy_px, dtype=np.float64), np.asarray(confidence, dtype=np.float64)
    if points.shape[:-1] != seen.shape[:-1] or trust.shape != seen.shape[:-1]:
        raise ValueError(
            f"points, keypoints and confidence must share (T, J), got {points.shape}, "
            f"{seen.shape} and {trust.shape}"
        )
    homogeneous = points @ np.asarray(K, dtype=np.float64).T
    depth = np.where(homogeneous[..., 2:] > 0, homogeneous[..., 2:], np.nan)
    error = np.linalg.norm(homogeneous[..., :2] / depth - seen, axis=-1)
    return np.where(trust > 0, error, np.nan)


def reprojection_error_px(errors_px: ArrayLike, confidence: ArrayLike) -> float:
    """Mean of `reprojection_errors_px`, weighted by confidence; NaN when nothing was seen."""
    error = np.asarray(errors_px, dtype=np.float64)
    weight = np.where(np.isfinite(error), np.asarray(confidence, dtype=np.float64), 0.0)
    total = weight.sum()
    return float(np.nansum(weight * error) / total) if total > 0 else float("nan")


def _relative(R_cam_from_world: ArrayLike, R_ref_from_world: ArrayLike) -> Array:
    R_ref = np.asarray(R_ref_from_world, dtype=np.float64)
    return np.asarray(R_cam_from_world, dtype=np.float64) @ np.swapaxes(R_ref, -1, -2)
