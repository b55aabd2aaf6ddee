"""How much of a motion its repetitions agree on: 1 when they are equal, 0 when no more alike than
unrelated moments of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HARDLY = 0.01  # a joint that moves less than this share of the one that moves most says nothing


def consistency(places: Array, inside: NDArray[np.bool_]) -> tuple[Array, float]:
    """Adjusted coefficient of determination of the moment, of every joint and of all together.

    ``1 - [sum (x - mean_t)^2 / sum (n_t - 1)] / [sum (x - mean)^2 / (sum n_t - 1)]``, sums over the
    moments t that at least two performances show and over the n_t performances that do; what
    Kadaba et al. (J. Orthop. Res. 1989) call the squared adjusted coefficient of multiple
    correlation, for places in space. Below 0 counts as 0.

    Args:
        places: (M, N, J, 3) of the joints, any unit. inside: (M, N).

    Returns:
        (J,) per joint, NaN for one that hardly moves (the pelvis from itself), and one number for
        all joints together, their squares summed.

    ValueError when no moment is shown by two performances.
    """
    inside = inside & (inside.sum(0) >= 2)
    count = inside.sum(0)
    if not count.any():
        raise ValueError("inside: expected a moment that two performances show, got none")
    weight = inside[..., None, None].astype(np.float64)
    at_moment = (weight * places).sum(0) / np.maximum(count, 1)[:, None, None]
    at_all = (weight * places).sum((0, 1)) / count.sum()
    within = (weight * (places - at_moment) ** 2).sum((0, 1, 3)) / (count - 1)[count > 0].sum()
    total = (weight * (places - at_all) ** 2).sum((0, 1, 3)) / (count.sum() - 1)
    moves = total > HARDLY**2 * max(float(total.max()), 1e-300)
    share = np.where(moves, within / np.where(moves, total, 1.0), np.nan)
    whole = float(within.sum() / total.sum()) if moves.any() else np.nan
    return np.maximum(1.0 - share, 0.0), max(1.0 - whole, 0.0)
