"""Warps as the paper finds them: one DTW path on each relaxed block."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imocap_core.params import SyncParams
from imocap_core.sync.pairwise.distance_matrix import Comparison
from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.sync.warp.positions import mass_within

Array = NDArray[np.float64]


def dtw_warps(
    c: Comparison,
    relaxed: NDArray[np.floating],
    maps: Array,
    reference: int,
    fps: Sequence[float],
    settings: SyncParams,
) -> tuple[list[Array], list[Array]]:
    """The paper's last step: DTW on each relaxed block; the confidence is that of the soft maps."""
    reach = settings.confidence_reach_s * fps[reference]
    skip = _skip_of(c, relaxed, reference, settings)
    frames, trust = [], []
    for v in range(len(c.poses)):
        block = np.asarray(c.blocks.block(relaxed, v, reference), dtype=float)
        path, _ = dtw(-block, skip=skip)
        position = positions_of_rows(path, len(block))
        soft = np.asarray(c.blocks.block(maps, v, reference))
        certain = mass_within(soft, np.nan_to_num(position), reach)
        frames.append(position)
        trust.append(np.where(np.isfinite(position), certain, 0.0))
    return frames, trust


def _skip_of(
    c: Comparison, relaxed: NDArray[np.floating], reference: int, settings: SyncParams
) -> float:
    """What an unmatched frame pays in DTW on minus the affinity: `unmatched_level` between best
    and typical entries."""
    if not np.isfinite(settings.unmatched_level):
        return np.inf
    others = [v for v in range(len(c.poses)) if v != reference]
    blocks = [np.asarray(c.blocks.block(relaxed, v, reference)) for v in others]
    best = float(np.mean([np.median(b.max(axis=1)) for b in blocks])) if blocks else 1.0
    usual = float(np.mean([np.median(b) for b in blocks])) if blocks else 0.0
    return -(best + settings.unmatched_level * (usual - best))
