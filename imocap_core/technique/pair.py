"""Two mean motions on one phase axis: where they differ, and by how much more than repetitions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.rotations import geodesic_angle

Array = NDArray[np.float64]

LEAST_M = 1e-3  # a spread below it counts as this much


@dataclass(frozen=True, eq=False)
class Difference:
    """At N moments: angle_deg (N, J) between the joints' rotations, distance_mm (N, J) between
    their places from the pelvis, ratio (N, J) of that distance to the repetitions' own spread."""

    angle_deg: Array
    distance_mm: Array
    ratio: Array


def difference(
    R_first: Array,
    R_second: Array,
    places_first: Array,
    places_second: Array,
    spread_first: Array,
    spread_second: Array,
) -> Difference:
    """Means (N, J, 3, 3) and (N, J, 3) metres of two performers, facing one way, on one body.

    spread_*: (N, J) metres, standard deviation of each one's repetitions, NaN where unknown. The
    ratio is to the root mean square of the two (of one, where the other is unknown), 1 mm at
    least; NaN where both are unknown.
    """
    angle = geodesic_angle(torch.as_tensor(R_first), torch.as_tensor(R_second)).numpy()
    distance = np.linalg.norm(places_second - places_first, axis=-1)
    squares = np.stack([spread_first, spread_second]) ** 2
    known = np.isfinite(squares)
    count = known.sum(0)
    pooled = np.sqrt(np.where(known, squares, 0.0).sum(0) / np.maximum(count, 1))
    ratio = np.where(count > 0, distance / np.maximum(pooled, LEAST_M), np.nan)
    return Difference(np.rad2deg(angle), 1000 * distance, ratio)
