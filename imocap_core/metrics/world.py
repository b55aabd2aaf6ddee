"""World metrics as published: W-MPJPE, WA-MPJPE, RTE, jitter, foot sliding.

Definitions: Ye et al., "Decoupling human and camera motion from videos in the wild" (SLAHMR), CVPR
2023; Shin et al., "WHAM", CVPR 2024; the evaluation code that Shen et al. released with "GVHMR",
SIGGRAPH Asia 2024, which is followed in details. Predictions and truth are in axes that do not
move, not necessarily the same ones.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from imocap_core.alignment import Alignment, rigid, similarity

MM_PER_M = 1000.0
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
    aligned = _applied(rigid(predicted_m, true_m), predicted_m)
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
        aligned = _applied(similarity(*anchors), predicted.reshape(-1, 3)).reshape(true.shape)
        errors.append(np.linalg.norm(aligned - true, axis=-1).ravel())
    return float(MM_PER_M * np.concatenate(errors).mean()) if errors else float("nan")


def _applied(alignment: Alignment, points_m: np.ndarray) -> np.ndarray:
    return np.asarray(alignment.apply(points_m))
