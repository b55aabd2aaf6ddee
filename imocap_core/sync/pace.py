"""How steadily each video goes through the action.

A video that stalls and jumps (freeze frames, edited slow motion, wrong poses) is a poor time axis:
on its frames every motion stalls and jumps, and that real motion is smooth speaks against the
truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls

from imocap_core.sync.map_consistency import PairMaps
from imocap_core.sync.phase import inside
from imocap_core.sync.warp.clocks import Clocks

WINDOW_S = 0.3  # of the action: over which a pace is measured


def pace_spread(pairs: PairMaps, lengths: Sequence[int], clocks: Clocks) -> Float[np.ndarray, " M"]:
    """Standard deviation (M,) of each video's pace about its usual one, which is 1.

    The pace of one video in another varies by the variances of both; all pairs tell them apart. Of
    two videos neither is known to be the one that varies: both have half.
    """
    M = len(lengths)
    videos = list(combinations(range(M), 2))
    shared = np.array([_pace_variance(pairs, pair, lengths, clocks) for pair in videos])
    measured = np.isfinite(shared)
    if not measured.any():
        return np.zeros(M)
    equations = np.array([[float(v in pair) for v in range(M)] for pair in videos])
    if M == 2:
        return np.sqrt(np.full(2, shared[0] / 2))
    return np.sqrt(nnls(equations[measured], shared[measured])[0])


def _pace_variance(
    pairs: PairMaps, pair: tuple[int, int], lengths: Sequence[int], clocks: Clocks
) -> float:
    """Of the pace of two videos in each other, relative to its mean; NaN where they share too
    little."""
    variances = []
    for i, j in (pair, pair[::-1]):
        position, steps = pairs.positions[i, j], max(1, round(WINDOW_S * clocks.action_fps[i]))
        shown = np.where(inside(np.nan_to_num(position), lengths[j]), position, np.nan)
        pace = shown[steps:] - shown[:-steps]
        pace = pace[np.isfinite(pace)]
        if len(pace) > steps and pace.mean() > 0:
            variances.append(float(np.var(pace / pace.mean())))
    return float(np.mean(variances)) if variances else np.nan
