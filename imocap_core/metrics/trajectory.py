"""How well the path of the root is recovered, and whether standing feet stand."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imocap_core.alignment import similarity

Array = NDArray[np.float64]

MM_PER_M = 1000.0


def root_path_error_mm(predicted_m: ArrayLike, true_m: ArrayLike) -> float:
    """Mean distance between two root paths (T, 3) once their centroids agree.

    Both in the axes of the video's camera, so neither rotation nor scale is removed: a wrong focal
    length or body size shows here. NaN frames are left out; NaN when none is left.
    """
    predicted, true = _seen(predicted_m, true_m)
    if not len(true):
        return float("nan")
    offset = (true - predicted).mean(axis=0)
    return float(MM_PER_M * np.linalg.norm(predicted + offset - true, axis=-1).mean())


def root_path_aligned_error_mm(predicted_m: ArrayLike, true_m: ArrayLike) -> float:
    """The same after one similarity alignment of the whole path: its shape alone.

    NaN when fewer than three frames have both.
    """
    predicted, true = _seen(predicted_m, true_m)
    aligned = similarity(predicted, true).apply(predicted)
    return float(MM_PER_M * np.linalg.norm(aligned - true, axis=-1).mean()) if len(true) else np.nan


def standing_feet(feet_m: ArrayLike, fps: float, still_m_s: float = 0.15) -> NDArray[np.bool_]:
    """Which feet (T, F, 3) stand: slower than ``still_m_s`` to both neighbouring frames (T, F)."""
    x = np.asarray(feet_m, dtype=np.float64)
    speed = fps * np.linalg.norm(np.diff(x, axis=0), axis=-1)
    slow = speed < still_m_s  # False for NaN: an unseen foot is not known to stand
    edge = np.ones((1, *slow.shape[1:]), dtype=bool)
    both = np.concatenate([edge, slow]) & np.concatenate([slow, edge])
    return np.asarray(both[: len(x)])


def foot_sliding_mm_s(
    feet_m: ArrayLike, standing: ArrayLike, fps: float, moving: ArrayLike | None = None
) -> float:
    """Mean speed of feet over the frames in which they should stand, in mm a second.

    Args:
        feet_m: (T, F, 3) predicted, in axes that do not move.
        standing: (T, F) from the truth (`standing_feet`), or any detector of contact.
        fps: frames a second.
        moving: (T, F, 3) the same feet in truth: its own small motion is subtracted.

    Returns:
        NaN when no foot stands for two frames in a row.
    """
    x = np.asarray(feet_m, dtype=np.float64)
    stand = np.asarray(standing, dtype=bool)
    if stand.shape != x.shape[:-1]:
        raise ValueError(f"standing must be {x.shape[:-1]} to match the feet, got {stand.shape}")
    if moving is not None:
        x = x - np.asarray(moving, dtype=np.float64)
    speed = fps * MM_PER_M * np.linalg.norm(np.diff(x, axis=0), axis=-1)
    speed = speed[stand[1:] & stand[:-1]]
    speed = speed[np.isfinite(speed)]
    return float(speed.mean()) if len(speed) else float("nan")


def planted_foot_speed_mm_s(feet_m: ArrayLike, standing: ArrayLike, fps: float) -> float:
    """Median speed of feet (T, F, 3) while they should stand (T, F), in mm a second.

    What a viewer sees as sliding: the truth's own small motion is not subtracted. NaN when no foot
    stands for two frames in a row.
    """
    x, stand = np.asarray(feet_m, dtype=np.float64), np.asarray(standing, dtype=bool)
    speed = fps * MM_PER_M * np.linalg.norm(np.diff(x, axis=0), axis=-1)
    speed = speed[stand[1:] & stand[:-1]]
    speed = speed[np.isfinite(speed)]
    return float(np.median(speed)) if len(speed) else float("nan")


def _seen(predicted_m: ArrayLike, true_m: ArrayLike) -> tuple[Array, Array]:
    predicted = np.asarray(predicted_m, dtype=np.float64)
    true = np.asarray(true_m, dtype=np.float64)
    if predicted.shape != true.shape or predicted.ndim != 2 or predicted.shape[-1] != 3:
        raise ValueError(f"paths must both be (T, 3), got {predicted.shape} and {true.shape}")
    seen = np.isfinite(predicted).all(axis=-1) & np.isfinite(true).all(axis=-1)
    return predicted[seen], true[seen]
