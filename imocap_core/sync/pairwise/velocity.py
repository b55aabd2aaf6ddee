"""Joint velocities as further points of a pose, to tell a movement there from the movement back."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.rigid_alignment import centred

REACH_S = 0.1  # velocities are differences over this long to both sides


def with_velocity(
    poses: Float[np.ndarray, "T J 3"],
    weights: Float[np.ndarray, "T J"],
    fps: float,
    weight_s: float,
) -> tuple[Float[np.ndarray, "T 2*J 3"], Float[np.ndarray, "T 2*J"]]:
    """Centred poses with their velocities times `weight_s` as further points, and the weights.

    A difference of 1 m/s then counts as much as one of `weight_s` metres, and one rotation aligns
    both. A velocity counts where the joint is visible at both ends of its interval.
    """
    about = centred(poses, weights)
    T, half = len(poses), max(1, round(REACH_S * fps))
    before = np.maximum(np.arange(T) - half, 0)
    after = np.minimum(np.arange(T) + half, T - 1)
    duration = np.maximum(after - before, 1)[:, None, None] / fps
    velocity = (about[after] - about[before]) / duration
    velocity_weights = np.sqrt(weights[after] * weights[before])
    return (
        np.concatenate([about, weight_s * velocity], axis=1),
        np.concatenate([weights, velocity_weights], axis=1),
    )
