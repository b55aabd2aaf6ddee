"""Difference of two mean motions on one phase axis, in units of the spread of repetitions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.rotations import geodesic_angle

LEAST_M = 1e-3  # a spread below it counts as this much


@dataclass(frozen=True, eq=False)
class Difference:
    """Difference of two mean motions at N moments.

    Attributes:
        angle_deg: between the joints' rotations.
        distance_mm: between their positions from the pelvis.
        ratio: of that distance to the repetitions' own spread.
    """

    angle_deg: Float[np.ndarray, "N J"]
    distance_mm: Float[np.ndarray, "N J"]
    ratio: Float[np.ndarray, "N J"]


def difference(
    R_first: Float[np.ndarray, "N J 3 3"],
    R_second: Float[np.ndarray, "N J 3 3"],
    positions_first: Float[np.ndarray, "N J 3"],
    positions_second: Float[np.ndarray, "N J 3"],
    spread_first: Float[np.ndarray, "N J"],
    spread_second: Float[np.ndarray, "N J"],
) -> Difference:
    """Compare the mean motions of two performers, facing one way, on one body.

    Positions and spreads in metres. spread_*: standard deviation of each performer's repetitions,
    NaN where unknown. The ratio is to the root mean square of the two (of one, where the other is
    unknown), at least 1 mm; NaN where both are unknown.
    """
    angle = geodesic_angle(torch.as_tensor(R_first), torch.as_tensor(R_second)).numpy()
    distance = np.linalg.norm(positions_second - positions_first, axis=-1)
    squares = np.stack([spread_first, spread_second]) ** 2
    valid = np.isfinite(squares)
    count = valid.sum(0)
    pooled = np.sqrt(np.where(valid, squares, 0.0).sum(0) / np.maximum(count, 1))
    ratio = np.where(count > 0, distance / np.maximum(pooled, LEAST_M), np.nan)
    return Difference(np.rad2deg(angle), 1000 * distance, ratio)
