"""Hand position errors: 21 keypoints relative to the wrist, both hands together."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.metrics import position


def hand_mpjpe_mm(
    predicted_m: Float[np.ndarray, "T 2 21 3"], true_m: Float[np.ndarray, "T 2 21 3"]
) -> float:
    """Mean distance of the keypoints, each hand relative to its wrist; nothing rotated."""
    return position.mpjpe_mm(*(_hands_as_frames(x) for x in (predicted_m, true_m)))


def hand_mpjpe_scaled_mm(
    predicted_m: Float[np.ndarray, "T 2 21 3"], true_m: Float[np.ndarray, "T 2 21 3"]
) -> float:
    """The same after each predicted hand is multiplied by |true|_F / |predicted|_F."""
    return position.mpjpe_scaled_mm(*(_hands_as_frames(x) for x in (predicted_m, true_m)))


def hand_pa_mpjpe_mm(
    predicted_m: Float[np.ndarray, "T 2 21 3"], true_m: Float[np.ndarray, "T 2 21 3"]
) -> float:
    """The same after a similarity Procrustes alignment of each hand in each frame: the fingers."""
    return position.pa_mpjpe_mm(*(_hands_as_frames(x) for x in (predicted_m, true_m)))


def _hands_as_frames(points_m: np.ndarray) -> np.ndarray:
    points = np.asarray(points_m, dtype=np.float64)
    if points.ndim != 4 or points.shape[1:] != (2, 21, 3):
        raise ValueError(f"hands: expected (T, 2, 21, 3), got {points.shape}")
    return (points - points[:, :, :1]).reshape(-1, 21, 3)
