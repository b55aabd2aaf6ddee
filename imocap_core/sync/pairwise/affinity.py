"""Affinities from pose distances (Eq. 1).

Paper, section 3.1: "we compute the Euclidean distance between each pair of 3D poses aligned by the
Procrustes method. Then, we map the reciprocal of distance to a value between [0,1]".
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def reciprocal_affinity(
    distance: Float[np.ndarray, "*shape"], scale: float
) -> Float[np.ndarray, "*shape"]:
    """The paper's map: the reciprocal of the distance, brought to [0, 1] as 1 / (1 + d / scale).

    1 at distance 0, 1/2 at `scale` (same unit as `distance`). Unknown distances (NaN) have
    affinity 0.
    """
    return np.nan_to_num(1.0 / (1.0 + distance / scale), nan=0.0)


def gaussian_affinity(
    distance: Float[np.ndarray, "*shape"], scale: float
) -> Float[np.ndarray, "*shape"]:
    """exp(-d^2 / (2 scale^2)): sharper than the reciprocal, 0.61 at `scale`. NaN distances have
    affinity 0."""
    return np.nan_to_num(np.exp(-0.5 * (distance / scale) ** 2), nan=0.0)
