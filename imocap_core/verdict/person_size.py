"""Size of a person in the picture."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def person_size(xy: Float[np.ndarray, "T K 2"]) -> float:
    """Diagonal of the keypoints' bounding box, as large as in one frame of ten; NaN if none."""
    complete = np.isfinite(xy).all(axis=(1, 2))
    if not complete.any():
        present = np.isfinite(xy).all(-1).sum(1) >= 2
        if not present.any():
            return float("nan")
        complete = present
    span = np.nanmax(xy[complete], axis=1) - np.nanmin(xy[complete], axis=1)
    return float(np.quantile(np.hypot(*span.T), 0.9))
