"""Errors of the root path, of the motion in the world as published, and of cameras.

World metrics as published: W-MPJPE, WA-MPJPE, RTE, jitter, foot sliding. Definitions: Ye et al.,
"Decoupling human and camera motion from videos in the wild" (SLAHMR), CVPR 2023; Shin et al.,
"WHAM", CVPR 2024; the evaluation code that Shen et al. released with "GVHMR", SIGGRAPH Asia 2024,
which is followed in details. Predictions and truth are in axes that do not move, not necessarily
the same ones.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from imocap_core.alignment import rigid, similarity

MM_PER_M = 1000.0


def root_path_error_mm(
    predicted_m: Float[np.ndarray, "T 3"], true_m: Float[np.ndarray, "T 3"]
) -> float:
    """Mean distance between two root paths after their centroids are aligned.

    Both in the axes of the video's camera, so neither rotation nor scale is removed: a wrong focal
    length or body size shows here. NaN frames are left out; NaN when none is left.
    """
    predicted, true = _valid_frames(predicted_m, true_m)
    if not len(true):
        return float("nan")
    offset = (true - predicted).mean(axis=0)
    return float(MM_PER_M * np.linalg.norm(predicted + offset - true, axis=-1).mean())


def root_path_aligned_error_mm(
    predicted_m: Float[np.ndarray, "T 3"], true_m: Float[np.ndarray, "T 3"]
) -> float:
    """The same after one similarity alignment of the whole path: the error of its shape.

    NaN when fewer than three frames have both.
    """
    predicted, true = _valid_frames(predicted_m, true_m)
    aligned = similarity(predicted, true).apply(predicted)
    return float(MM_PER_M * np.linalg.norm(aligned - true, axis=-1).mean()) if len(true) else np.nan


def foot_contacts(
    feet_m: Float[np.ndarray, "T F 3"], fps: float, still_m_s: float = 0.15
) -> Bool[np.ndarray, "T F"]:
    """Foot contact by speed: slower than ``still_m_s`` to both neighbouring frames."""
    x = np.asarray(feet_m, dtype=np.float64)
    speed = fps * np.linalg.norm(np.diff(x, axis=0), axis=-1)
    slow = speed < still_m_s  # False for NaN: contact of a missing foot is unknown
    edge = np.ones((1, *slow.shape[1:]), dtype=bool)
    both = np.concatenate([edge, slow]) & np.concatenate([slow, edge])
    return np.asarray(both[: len(x)])


def foot_sliding_mm_s(
    feet_m: Float[np.ndarray, "T F 3"],
    contact: Bool[np.ndarray, "T F"],
    fps: float,
    true_feet_m: Float[np.ndarray, "T F 3"] | None = None,
) -> float:
    """Mean speed of the feet while they are in contact, in mm a second.

    Args:
        feet_m: predicted feet, in axes that do not move.
        contact: from the truth (`foot_contacts`), or any detector of contact.
        fps: frames a second.
        true_feet_m: the true feet, whose small motion during contact is subtracted.

    Returns:
        NaN when no foot is in contact for two frames in a row.
    """
    x = np.asarray(feet_m, dtype=np.float64)
    if np.shape(contact) != x.shape[:-1]:
        raise ValueError(
            f"contact must be {x.shape[:-1]} to match the feet, got {np.shape(contact)}"
        )
    if true_feet_m is not None:
        x = x - np.asarray(true_feet_m, dtype=np.float64)
    speed = _contact_speeds(x, contact, fps)
    return float(speed.mean()) if len(speed) else float("nan")


def planted_foot_speed_mm_s(
    feet_m: Float[np.ndarray, "T F 3"], contact: Bool[np.ndarray, "T F"], fps: float
) -> float:
    """Median speed of the feet while they are in contact, in mm a second.

    What a viewer sees as sliding: the truth's own small motion is not subtracted. NaN when no foot
    is in contact for two frames in a row.
    """
    speed = _contact_speeds(np.asarray(feet_m, dtype=np.float64), contact, fps)
    return float(np.median(speed)) if len(speed) else float("nan")


def _contact_speeds(feet_m: np.ndarray, contact: np.ndarray, fps: float) -> np.ndarray:
    """Speeds (N,) in mm a second between two frames in which a foot is in contact."""
    contact = np.asarray(contact, dtype=bool)
    speed = fps * MM_PER_M * np.linalg.norm(np.diff(feet_m, axis=0), axis=-1)
    speed = speed[contact[1:] & contact[:-1]]
    return np.asarray(speed[np.isfinite(speed)])


def _valid_frames(predicted_m: np.ndarray, true_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    predicted = np.asarray(predicted_m, dtype=np.float64)
    true = np.asarray(true_m, dtype=np.float64)
    if predicted.shape != true.shape or predicted.ndim != 2 or predicted.shape[-1] != 3:
        raise ValueError(f"paths must both be (T, 3), got {predicted.shape} and {true.shape}")
    valid = np.isfinite(predicted).all(axis=-1) & np.isfinite(true).all(axis=-1)
    return predicted[valid], true[valid]


SEGMENT = 100
"""Frames of the segments of W-MPJPE and WA-MPJPE; the last segment may be shorter."""

PUBLISHED_FPS = 30.0
STILL_M = 0.01
"""True displacement per 1/30 s below which a point of a foot is in contact with the ground."""


def w_mpjpe_mm(
    predicted_m: Float[np.ndarray, "T J 3"], true_m: Float[np.ndarray, "T J 3"]
) -> float:
    """W-MPJPE: segments of 100 frames, each aligned on its first two frames by one similarity.

    Mean over joints and frames, in mm. Grows with drift after the first frames. Invariant to a
    similarity transform of each segment. NaN without frames; joints without NaN are expected.
    """
    return _segment_error_mm(predicted_m, true_m, aligned_on=2)


def wa_mpjpe_mm(
    predicted_m: Float[np.ndarray, "T J 3"], true_m: Float[np.ndarray, "T J 3"]
) -> float:
    """WA-MPJPE: segments of 100 frames, each aligned as a whole by one similarity.

    Mean over joints and frames, in mm. Invariant to a similarity transform of each segment.
    """
    return _segment_error_mm(predicted_m, true_m, aligned_on=SEGMENT)


def rte_pct(predicted_m: Float[np.ndarray, "T 3"], true_m: Float[np.ndarray, "T 3"]) -> float:
    """Root translation error (RTE): per cent of the length of the true path.

    Mean distance of the root to its truth after one rigid alignment (no scale) of the whole path.
    A performer who stays on the spot has a short path and so a large RTE. Invariant to a rigid
    motion of the prediction. NaN when the true root does not move.
    """
    aligned = rigid(predicted_m, true_m).apply(predicted_m)
    error = np.linalg.norm(aligned - true_m, axis=-1).mean() if len(true_m) else np.nan
    length = np.linalg.norm(np.diff(true_m, axis=0), axis=-1).sum()
    return float(100 * error / length) if length > 0 else float("nan")


def jitter_10m_s3(
    joints_m: Float[np.ndarray, "T J 3"], frames: Int[np.ndarray, " T"], fps: float
) -> float:
    """Jitter: mean norm of the joints' jerk (third derivative), in units of 10 m/s^3.

    Yi et al., "TransPose", SIGGRAPH 2021; by third differences, in the published unit. Needs no
    truth; a true motion's is above zero. Invariant to a rigid motion and to constant acceleration.

    Args:
        frames: source frame numbers; only four frames in a row, one apart, count.
        fps: frames a second of the source.

    Returns:
        NaN when no four frames follow each other.
    """
    steps = np.diff(frames) == 1
    in_a_row = steps[2:] & steps[1:-1] & steps[:-2]
    jerk = fps**3 * np.linalg.norm(np.diff(joints_m, n=3, axis=0)[in_a_row], axis=-1)
    return float(jerk.mean() / 10) if len(jerk) else float("nan")


def foot_sliding_mm(
    predicted_m: Float[np.ndarray, "T F 3"],
    true_m: Float[np.ndarray, "T F 3"],
    frames: Int[np.ndarray, " T"],
    fps: float,
) -> float:
    """Foot sliding: mean displacement of the feet's points during true contact, mm per 1/30 s.

    A point is in contact from one frame to the next when the truth moves by less than 10 mm per
    1/30 s. Published of four vertices of SMPL, a heel and a toe of each foot, in videos of 30
    frames a second; at other rates displacements are those of 1/30 s. The truth's displacement is
    not subtracted. Invariant to a rigid motion of the prediction.

    Args:
        predicted_m, true_m: points of the feet.
        frames: source frame numbers; only frames one apart count.

    Returns:
        NaN when no point is in contact.
    """
    consecutive = np.diff(frames) == 1
    predicted, true = (
        fps / PUBLISHED_FPS * np.linalg.norm(np.diff(x, axis=0), axis=-1)[consecutive]
        for x in (predicted_m, true_m)
    )
    sliding = predicted[true < STILL_M]
    return float(MM_PER_M * sliding.mean()) if len(sliding) else float("nan")


def _segment_error_mm(predicted_m: np.ndarray, true_m: np.ndarray, aligned_on: int) -> float:
    """Mean error over all segments, each aligned on its first `aligned_on` frames."""
    errors = []
    for start in range(0, len(true_m), SEGMENT):
        predicted, true = (x[start : start + SEGMENT] for x in (predicted_m, true_m))
        anchors = (x[:aligned_on].reshape(-1, 3) for x in (predicted, true))
        points = predicted.reshape(-1, 3)
        aligned = np.reshape(similarity(*anchors).apply(points), true.shape)
        errors.append(np.linalg.norm(aligned - true, axis=-1).ravel())
    return float(MM_PER_M * np.concatenate(errors).mean()) if errors else float("nan")


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
