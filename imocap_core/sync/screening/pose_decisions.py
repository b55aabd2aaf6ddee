"""Decisions by 3D poses alone, where no keypoints are given: the evidence of `evidence`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from imocap_core.sync.screening.decisions import Decisions
from imocap_core.sync.screening.evidence import WeightedPoses, mirrored_among, outliers_among
from imocap_core.sync.screening.mirror import CLEAR_MARGIN


def decide_by_poses(
    plain: WeightedPoses,
    reflected: WeightedPoses,
    rates: Sequence[float],
    max_rate: float,
    pinned: Sequence[bool],
    never_outliers: Bool[np.ndarray, " M"],
    *,
    look_mirrored: bool,
    look_outliers: bool,
) -> Decisions:
    """Mirrored videos, then, with those reflected, videos of another action.

    Args:
        rates: frame rates of the poses; max_rate: as `sync.max_rate`.
        pinned: videos whose reflection is given; never_outliers: videos that stay in any case.
    """
    margin, score = np.full((2, len(rates)), np.nan)
    mirrored: list[int] = []
    outliers: list[int] = []
    if look_mirrored:
        mirrored, margin = mirrored_among(plain, reflected, rates, max_rate, pinned)
    if look_outliers:
        upright, _ = plain.swapped(mirrored, reflected)
        outliers, score = outliers_among(upright, rates, max_rate, never_outliers)
        # another action has no mirror image here
        mirrored = [v for v in mirrored if v not in outliers]
    return Decisions(
        mirrored=tuple(mirrored),
        outliers=tuple(outliers),
        margin=margin,
        score=score,
        clearly_mirrored=tuple(v for v in mirrored if margin[v] > CLEAR_MARGIN),
    )
