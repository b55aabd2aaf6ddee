"""Camera errors: rotation between two cameras, and reprojection of the body onto the detections."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.alignment import similarity


def camera_rotation_error_deg(
    R_cam_from_world: Float[np.ndarray, "... 3 3"],
    R_ref_from_world: Float[np.ndarray, "... 3 3"],
    R_cam_from_true_world: Float[np.ndarray, "... 3 3"],
    R_ref_from_true_world: Float[np.ndarray, "... 3 3"],
) -> Float[np.ndarray, "..."]:
    """Angle between the recovered and the true rotation from the reference to another camera.

    The recovered world is the reference camera's axes and the true world is anything, so only the
    relative rotation ``R_cam_from_ref = R_cam_from_world @ R_ref_from_world.T`` can be compared.
    The leading axes broadcast.
    """
    recovered = _relative(R_cam_from_world, R_ref_from_world)
    true = _relative(R_cam_from_true_world, R_ref_from_true_world)
    return rotation_angle_deg(recovered @ np.swapaxes(true, -1, -2))


def camera_place_errors_mm(
    centres_m: Float[np.ndarray, "M 3"], true_centres_m: Float[np.ndarray, "M 3"]
) -> Float[np.ndarray, " M"]:
    """Distances of the cameras' places from the true ones after one similarity of all of them: the
    world of a result has axes, an origin and a unit of its own.

    Raises:
        ValueError: shapes that differ.
    """
    moved = similarity(centres_m, true_centres_m).apply(centres_m)
    return 1000 * np.linalg.norm(moved - true_centres_m, axis=1)


def focal_error_pct(focal_px: float, true_focal_px: float) -> float:
    """Absolute logarithm of a focal length over the true one, times 100: too long and too short by
    the same factor are equally wrong."""
    return 100 * abs(float(np.log(focal_px / true_focal_px)))


def rotation_angle_deg(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch"]:
    """Angle of rotation matrices, in degrees, 0 to 180."""
    matrices = np.asarray(R, dtype=np.float64)
    angles = Rotation.from_matrix(matrices.reshape(-1, 3, 3)).magnitude()
    return np.degrees(np.asarray(angles)).reshape(matrices.shape[:-2])


def reprojection_errors_px(
    points_cam_m: Float[np.ndarray, "T J 3"],
    K: Float[np.ndarray, "3 3"],
    xy_px: Float[np.ndarray, "T J 2"],
    confidence: Float[np.ndarray, "T J"],
) -> Float[np.ndarray, "T J"]:
    """Distance of projected points to the detected keypoints, NaN where undetected or behind.

    Args:
        points_cam_m: points in camera axes, metres.
        K: camera matrix.
        xy_px: detected keypoints.
        confidence: of the detections; 0 means not detected.

    Raises:
        ValueError: points, keypoints and confidence differ in (T, J).
    """
    points = np.asarray(points_cam_m, dtype=np.float64)
    keypoints = np.asarray(xy_px, dtype=np.float64)
    scores = np.asarray(confidence, dtype=np.float64)
    if points.shape[:-1] != keypoints.shape[:-1] or scores.shape != keypoints.shape[:-1]:
        raise ValueError(
            f"points, keypoints and confidence must share (T, J), got {points.shape}, "
            f"{keypoints.shape} and {scores.shape}"
        )
    homogeneous = points @ np.asarray(K, dtype=np.float64).T
    depth = np.where(homogeneous[..., 2:] > 0, homogeneous[..., 2:], np.nan)
    error = np.linalg.norm(homogeneous[..., :2] / depth - keypoints, axis=-1)
    return np.where(scores > 0, error, np.nan)


def reprojection_error_px(
    errors_px: Float[np.ndarray, "T J"], confidence: Float[np.ndarray, "T J"]
) -> float:
    """Mean of `reprojection_errors_px` weighted by confidence; NaN when nothing was detected."""
    error = np.asarray(errors_px, dtype=np.float64)
    weight = np.where(np.isfinite(error), np.asarray(confidence, dtype=np.float64), 0.0)
    total = weight.sum()
    return float(np.nansum(weight * error) / total) if total > 0 else float("nan")


def _relative(R_cam_from_world: np.ndarray, R_ref_from_world: np.ndarray) -> np.ndarray:
    R_ref = np.asarray(R_ref_from_world, dtype=np.float64)
    return np.asarray(R_cam_from_world, dtype=np.float64) @ np.swapaxes(R_ref, -1, -2)
