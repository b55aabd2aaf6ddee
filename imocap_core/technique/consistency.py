"""Consistency of repetitions: the coefficient of multiple correlation of gait analysis, squared.

1 when all performances are equal, 0 when they are no more alike than unrelated moments of them.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

LEAST_MOTION = 0.01  # of the standard deviation of the joint that moves most: less is no motion


def consistency(
    positions: Float[np.ndarray, "M N J 3"], inside: Bool[np.ndarray, "M N"]
) -> tuple[Float[np.ndarray, " J"], float]:
    """Adjusted coefficient of determination of the moment, for every joint and for all together.

    ``1 - [sum (x - mean_t)^2 / sum (n_t - 1)] / [sum (x - mean)^2 / (sum n_t - 1)]``, sums over the
    moments t that at least two performances show and over the n_t performances that do; what
    Kadaba et al. (J. Orthop. Res. 1989) call the squared adjusted coefficient of multiple
    correlation, for positions in space. Below 0 counts as 0.

    Args:
        positions: of the joints, any unit.
        inside: whether a performance shows a moment.

    Returns:
        One number a joint, NaN for one that hardly moves (the pelvis relative to itself), and one
        number for all joints together, their squares summed.

    Raises:
        ValueError: no moment is shown by two performances.
    """
    inside = inside & (inside.sum(0) >= 2)
    count = inside.sum(0)
    if not count.any():
        raise ValueError("inside: expected a moment that two performances show, got none")
    weight = inside[..., None, None].astype(np.float64)
    mean_of_moment = (weight * positions).sum(0) / np.maximum(count, 1)[:, None, None]
    mean_of_all = (weight * positions).sum((0, 1)) / count.sum()
    degrees_of_freedom = (count - 1)[count > 0].sum()
    within = (weight * (positions - mean_of_moment) ** 2).sum((0, 1, 3)) / degrees_of_freedom
    total = (weight * (positions - mean_of_all) ** 2).sum((0, 1, 3)) / (count.sum() - 1)
    moves = total > LEAST_MOTION**2 * max(float(total.max()), 1e-300)
    share = np.where(moves, within / np.where(moves, total, 1.0), np.nan)
    whole = float(within.sum() / total.sum()) if moves.any() else np.nan
    return np.maximum(1.0 - share, 0.0), max(1.0 - whole, 0.0)
