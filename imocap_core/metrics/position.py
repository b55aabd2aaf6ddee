"""Joint position errors of bodies and hands: mean over joints, then over frames.

A NaN joint or frame is left out. All take root-relative joints (T, J, 3) in metres
(`metrics.joints.root_relative`), prediction and truth in the axes of the same camera, and return
millimetres; ValueError where the two shapes differ. Means over videos and actions, unweighted, are
the caller's.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Real

from imocap_core.alignment import similarity

HIPS = ("left_hip", "right_hip")


def missing_joints(names: Sequence[str], wanted: Sequence[str]) -> tuple[str, ...]:
    """The wanted joints that are not among ``names``, in the order wanted."""
    return tuple(name for name in wanted if name not in set(names))


def select_joints(
    joints: Float[np.ndarray, "*batch J 3"], names: Sequence[str], wanted: Sequence[str]
) -> Float[np.ndarray, "*batch W 3"]:
    """The wanted joints, in the order of ``wanted``.

    Raises:
        ValueError: ``names`` does not name every joint, or lacks one that is wanted.
    """
    x = np.asarray(joints, dtype=np.float64)
    if x.ndim < 2 or x.shape[-2:] != (len(names), 3):
        raise ValueError(f"joints must be (..., {len(names)}, 3) to match its names, got {x.shape}")
    absent = missing_joints(names, wanted)
    if absent:
        raise ValueError(f"joints lack {', '.join(absent)}; they have {', '.join(names)}")
    index = {name: i for i, name in enumerate(names)}
    return x[..., [index[name] for name in wanted], :]


def hip_midpoint(
    joints: Float[np.ndarray, "*batch J 3"], names: Sequence[str]
) -> Float[np.ndarray, "*batch 3"]:
    """The evaluation's pelvis: the midpoint of both hips."""
    return select_joints(joints, names, HIPS).mean(axis=-2)


def root_relative(
    joints: Float[np.ndarray, "*batch J 3"], names: Sequence[str], wanted: Sequence[str]
) -> Float[np.ndarray, "*batch W 3"]:
    """The wanted joints relative to the midpoint of the hips."""
    return select_joints(joints, names, wanted) - hip_midpoint(joints, names)[..., None, :]


MM_PER_M = 1000.0


def mpjpe_mm(predicted_m: Float[np.ndarray, "T J 3"], true_m: Float[np.ndarray, "T J 3"]) -> float:
    """Mean per-joint position error, nothing scaled: the paper text's MPJPE."""
    return mean_over_frames(joint_errors_mm(predicted_m, true_m))


def mpjpe_scaled_mm(
    predicted_m: Float[np.ndarray, "T J 3"], true_m: Float[np.ndarray, "T J 3"]
) -> float:
    """MPJPE after each predicted frame is multiplied by |true|_F / |predicted|_F.

    The authors' released evaluation does this, so it is the one to compare with the paper's
    66.53 mm.
    """
    return mpjpe_mm(_scaled_to_truth(predicted_m, true_m), true_m)


def pa_mpjpe_mm(
    predicted_m: Float[np.ndarray, "T J 3"], true_m: Float[np.ndarray, "T J 3"]
) -> float:
    """MPJPE after a similarity Procrustes alignment of each frame (P-MPJPE)."""
    predicted, true = _paired(predicted_m, true_m)
    return mpjpe_mm(similarity(predicted, true).apply(predicted), true)


def _scaled_to_truth(
    predicted_m: Float[np.ndarray, "T J 3"], true_m: Float[np.ndarray, "T J 3"]
) -> Float[np.ndarray, "T J 3"]:
    """Each frame of the prediction times |true|_F / |predicted|_F, over the joints both have."""
    predicted, true = _paired(predicted_m, true_m)
    valid = np.asarray(np.isfinite(predicted + true).all(axis=-1))
    squares = [np.where(valid[..., None], x, 0.0) ** 2 for x in (true, predicted)]
    of_true, of_predicted = (square.sum(axis=(-1, -2)) for square in squares)
    ratio = np.sqrt(of_true / np.where(of_predicted > 0, of_predicted, np.nan))
    return predicted * ratio[:, None, None]


def joint_errors_mm(
    predicted_m: Float[np.ndarray, "T J 3"], true_m: Float[np.ndarray, "T J 3"]
) -> Float[np.ndarray, "T J"]:
    """Distance of every joint to its truth, NaN where either is missing."""
    predicted, true = _paired(predicted_m, true_m)
    difference = predicted - true
    return MM_PER_M * np.sqrt(np.einsum("tjc,tjc->tj", difference, difference))


def mean_joint_errors_mm(
    predicted_m: Float[np.ndarray, "T J 3"], true_m: Float[np.ndarray, "T J 3"]
) -> Float[np.ndarray, " J"]:
    """Mean over frames of each joint's error, NaN for a joint that is missing throughout."""
    return _nanmean(joint_errors_mm(predicted_m, true_m), axis=0)


def acceleration_error_m_s2(
    predicted_m: Float[np.ndarray, "T J 3"],
    true_m: Float[np.ndarray, "T J 3"],
    frames: Real[np.ndarray, " T"],
    fps: float,
) -> float:
    """Mean |predicted - true| joint acceleration, by second differences.

    Args:
        predicted_m, true_m: joints, metres.
        frames: source frame numbers; only three frames in a row, one apart, count.
        fps: frames a second of the source.

    Returns:
        Metres per second squared; NaN when no three frames follow each other.
    """
    predicted, true = _paired(predicted_m, true_m)
    numbers = np.asarray(frames)
    if numbers.shape != predicted.shape[:1]:
        raise ValueError(f"frames must be ({predicted.shape[0]},), got {numbers.shape}")
    steps = np.diff(numbers)
    in_a_row = (steps[1:] == 1) & (steps[:-1] == 1)
    error = np.diff(predicted - true, n=2, axis=0)[in_a_row]
    return fps**2 * mean_over_frames(np.linalg.norm(error, axis=-1))


def _paired(predicted_m: np.ndarray, true_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    predicted = np.asarray(predicted_m, dtype=np.float64)
    true = np.asarray(true_m, dtype=np.float64)
    if predicted.shape != true.shape or predicted.ndim != 3 or predicted.shape[-1] != 3:
        raise ValueError(
            f"prediction and truth must both be (T, J, 3), got {predicted.shape} and {true.shape}"
        )
    return predicted, true


def mean_over_frames(errors: Float[np.ndarray, "T J"]) -> float:
    """Mean over the joints of each frame, then over frames; NaN is left out."""
    return float(_nanmean(_nanmean(errors, axis=1), axis=0))


def _nanmean(values: np.ndarray, axis: int) -> np.ndarray:
    with warnings.catch_warnings():  # a frame without any joint is NaN by intent
        warnings.filterwarnings("ignore", "Mean of empty slice", RuntimeWarning)
        return np.asarray(np.nanmean(values, axis=axis))


def hand_mpjpe_mm(
    predicted_m: Float[np.ndarray, "T 2 21 3"], true_m: Float[np.ndarray, "T 2 21 3"]
) -> float:
    """Mean distance of the keypoints, each hand relative to its wrist; nothing rotated."""
    return mpjpe_mm(*(_hands_as_frames(x) for x in (predicted_m, true_m)))


def hand_mpjpe_scaled_mm(
    predicted_m: Float[np.ndarray, "T 2 21 3"], true_m: Float[np.ndarray, "T 2 21 3"]
) -> float:
    """The same after each predicted hand is multiplied by |true|_F / |predicted|_F."""
    return mpjpe_scaled_mm(*(_hands_as_frames(x) for x in (predicted_m, true_m)))


def hand_pa_mpjpe_mm(
    predicted_m: Float[np.ndarray, "T 2 21 3"], true_m: Float[np.ndarray, "T 2 21 3"]
) -> float:
    """The same after a similarity Procrustes alignment of each hand in each frame: the fingers."""
    return pa_mpjpe_mm(*(_hands_as_frames(x) for x in (predicted_m, true_m)))


def _hands_as_frames(points_m: np.ndarray) -> np.ndarray:
    points = np.asarray(points_m, dtype=np.float64)
    if points.ndim != 4 or points.shape[1:] != (2, 21, 3):
        raise ValueError(f"hands: expected (T, 2, 21, 3), got {points.shape}")
    return (points - points[:, :, :1]).reshape(-1, 21, 3)
