"""Poses that carry how they move: where a movement passes one pose twice, there and back, the
velocities tell the two apart."""

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.pairwise.view_axes import centred

Array = NDArray[np.float64]

REACH_S = 0.1  # velocities are taken over this long to both sides


def with_velocity(poses: Array, weights: Array, fps: float, weight_s: float) -> tuple[Array, Array]:
    """Poses (T, J, 3) about their centroids with their velocities times `weight_s` as further
    points, (T, 2 J, 3), and the weights (T, 2 J).

    A difference of 1 m/s then counts as much as one of `weight_s` metres, and one rotation aligns
    both. A velocity counts where the joint is seen at both ends of its interval.
    """
    about = centred(poses, weights)
    T, half = len(poses), max(1, round(REACH_S * fps))
    before = np.maximum(np.arange(T) - half, 0)
    after = np.minimum(np.arange(T) + half, T - 1)
    lasted = np.maximum(after - before, 1)[:, None, None] / fps
    velocity = (about[after] - about[before]) / lasted
    counted = np.sqrt(weights[after] * weights[before])
    return (
        np.concatenate([about, weight_s * velocity], axis=1),
        np.concatenate([weights, counted], axis=1),
    )
