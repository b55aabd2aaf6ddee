"""A rotation at a local minimum of a residual, by coordinate search (pattern search)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

LEAST_GAIN = 1e-9


def refined_rotation(
    R: Float[np.ndarray, "3 3"],
    residuals: Callable[[Float[np.ndarray, "D 3 3"]], Float[np.ndarray, " D"]],
    steps_deg: Sequence[float],
) -> tuple[Float[np.ndarray, "3 3"], float]:
    """The rotation to which turns about the six half axes lead, and its residual.

    Args:
        residuals: of some rotations at once. steps_deg: angles of the turns, one after another.
    """
    least = float(residuals(R[None])[0])
    for step_deg in steps_deg:
        vectors = np.concatenate([np.eye(3), -np.eye(3)]) * np.deg2rad(step_deg)
        turns = Rotation.from_rotvec(vectors).as_matrix()
        while True:
            near = turns @ R
            values = residuals(near)
            if values.min() >= least - LEAST_GAIN:
                break
            R, least = near[values.argmin()], float(values.min())
    return R, least
