"""Positions of phases among the frames of a video."""

import numpy as np
from jaxtyping import Float


def positions_in(
    phase: Float[np.ndarray, " T"], other: Float[np.ndarray, " S"]
) -> Float[np.ndarray, " T"]:
    """Position of phases among another video's frames, fractional; NaN outside its range."""
    frames = np.arange(len(other), dtype=np.float64)
    if not np.isfinite(other).all():
        return np.full(len(phase), np.nan)
    rising = other + 1e-9 * frames  # of frames of equal phase, any will do
    return np.interp(phase, rising, frames, left=np.nan, right=np.nan)
