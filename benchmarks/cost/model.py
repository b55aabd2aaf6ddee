"""A stage's cost as a sum of few terms in the number of videos, frames and keypoints.

    cost = a + b V + c V T + d V T K + e P + f P T^2,  P = V (V - 1) / 2

V videos of T frames with K keypoints, P pairs of videos; no coefficient is negative. Fitted to
relative errors, as the sizes differ by a factor of forty (non-negative least squares, Lawson and
Hanson 1974).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

Size = tuple[int, int, int]  # videos, frames of each, keypoints
TERMS: dict[str, Callable[[int, int, int], float]] = {
    "fixed": lambda V, T, K: 1.0,
    "a video": lambda V, T, K: float(V),
    "a frame": lambda V, T, K: float(V * T),
    "a keypoint": lambda V, T, K: float(V * T * K),
    "a pair of videos": lambda V, T, K: V * (V - 1) / 2,
    "a pair of frames": lambda V, T, K: V * (V - 1) / 2 * float(T) ** 2,
}


@dataclass(frozen=True)
class CostModel:
    """Coefficients of TERMS, in the unit of the cost."""

    coefficients: Mapping[str, float]

    def at(self, size: Size) -> float:
        """The predicted cost."""
        return sum(self.coefficients[name] * term(*size) for name, term in TERMS.items())


def fitted(sizes: Sequence[Size], costs: Sequence[float]) -> CostModel:
    """The model with the least sum of squared relative errors.

    ValueError unless all costs are positive.
    """
    if not sizes or min(costs) <= 0:
        raise ValueError(f"costs: expected positive ones, got {list(costs)}")
    relative = np.array([[term(*size) for term in TERMS.values()] for size in sizes])
    relative /= np.asarray(costs)[:, None]
    scale = relative.max(axis=0)
    scaled, _ = nnls(relative / scale, np.ones(len(sizes)))
    return CostModel(dict(zip(TERMS, (scaled / scale).tolist(), strict=True)))
