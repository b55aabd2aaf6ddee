"""The ground of a world as a value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground plane of a world: points x with up . (x - origin) = 0.

    Attributes:
        up: (3,) unit vector against gravity, in the world's axes.
        origin: (3,) the point of the ground under the mean place of the bodies, metres.
        tilt_sd_deg: standard deviation of up about each horizontal axis, degrees.
        height_sd_mm: standard deviation of the ground's height under the bodies; NaN where no body
            tells it.
    """

    up: Float[np.ndarray, "3"]
    origin: Float[np.ndarray, "3"]
    tilt_sd_deg: float
    height_sd_mm: float

    def height_m(self, points: Float[np.ndarray, "*N 3"]) -> Float[np.ndarray, "*N"]:
        """Height of points (..., 3) of the world above the ground, metres."""
        return np.asarray((points - self.origin) @ self.up)

    def moved(self, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> Ground:
        """The same plane in the world of the points R x + t."""
        return Ground(R @ self.up, R @ self.origin + t, self.tilt_sd_deg, self.height_sd_mm)
