"""Runs of frames."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float


def runs(flags: Bool[np.ndarray, " T"], least: int, gap: int = 0) -> list[tuple[int, int]]:
    """First and last index of each run of True of at least `least` frames; runs that at most `gap`
    frames separate are one."""
    index = np.flatnonzero(flags)
    if not len(index):
        return []
    cuts = np.flatnonzero(np.diff(index) > gap + 1)
    begins, ends = index[np.r_[0, cuts + 1]], index[np.r_[cuts, len(index) - 1]]
    return [(int(a), int(b)) for a, b in zip(begins, ends, strict=True) if b - a + 1 >= least]


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
