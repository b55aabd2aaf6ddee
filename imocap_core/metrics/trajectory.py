"""Errors of the root path, and sliding of feet that are in contact with the ground."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.alignment import similarity

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
