"""Runs of frames in which something holds."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool


def runs(flags: Bool[np.ndarray, " T"], least: int = 1, gap: int = 0) -> list[tuple[int, int]]:
    """First and last index of each run of True of at least `least` frames; runs that at most `gap`
    frames separate are one."""
    index = np.flatnonzero(flags)
    if not len(index):
        return []
    cuts = np.flatnonzero(np.diff(index) > gap + 1)
    begins, ends = index[np.r_[0, cuts + 1]], index[np.r_[cuts, len(index) - 1]]
    return [(int(a), int(b)) for a, b in zip(begins, ends, strict=True) if b - a + 1 >= least]
