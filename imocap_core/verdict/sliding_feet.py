"""Feet that stand still in the picture and move in space: they move along the line of sight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.runs import runs

WINDOW_S = 0.1
STILL = 0.012  # of the person's size, over the window
LEAST_SPEED_M_S = 1.0
LEAST_FRAMES = 2


@dataclass(frozen=True)
class Slide:
    """Frames `first` to `last` (indices, both within) and the largest speed in them."""

    first: int
    last: int
    speed_m_s: float


def slides(
    ankle_m: Float[np.ndarray, "T 3"],
    ankle_px: Float[np.ndarray, "T 2"],
    size_px: float,
    fps: float,
) -> list[Slide]:
    """Spans in which an ankle is still in the picture and fast in space.

    Args:
        ankle_m: in the axes of the video's first-frame camera.
        ankle_px: the detection, warped into the first frame; NaN where not detected.
        size_px: of the person.
    """
    step = max(1, round(WINDOW_S * fps))
    if len(ankle_m) <= step:
        return []
    speed = np.linalg.norm(ankle_m[step:] - ankle_m[:-step], axis=-1) * fps / step
    moved = np.linalg.norm(ankle_px[step:] - ankle_px[:-step], axis=-1) / size_px
    sliding = (speed > LEAST_SPEED_M_S) & (np.nan_to_num(moved, nan=np.inf) < STILL)
    return [
        Slide(first, last + step, float(speed[first : last + 1].max()))
        for first, last in runs(sliding, LEAST_FRAMES, step)
    ]
