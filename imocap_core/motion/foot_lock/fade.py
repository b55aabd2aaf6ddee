"""Corrections that are anchored in some frames fade in before and out after."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float


def faded(
    correction: Float[np.ndarray, "T n"], anchored: Bool[np.ndarray, " T"], fade: int
) -> Float[np.ndarray, "T n"]:
    """The correction in anchored frames; elsewhere that of the nearest anchored frame before, times
    a weight that falls smoothly from 1 to 0 within `fade` frames (or within the gap, where that is
    shorter), plus that of the nearest after, likewise."""
    filled = np.where(anchored[:, None], correction, 0.0)
    frames = np.flatnonzero(anchored)
    for t in np.flatnonzero(~anchored):
        after = int(np.searchsorted(frames, t))
        before, next_one = frames[after - 1 : after], frames[after : after + 1]
        gap = int(next_one[0] - before[0]) if len(before) and len(next_one) else 2 * fade
        for edge in (*before, *next_one):
            weight = 1.0 - abs(int(edge) - int(t)) / max(1, min(fade, gap))
            filled[t] += smooth_step(weight) * correction[edge]
    return filled


def smooth_step(x: float) -> float:
    """From 0 to 1 with slope 0 at both ends; 0 below 0, 1 above 1."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)
