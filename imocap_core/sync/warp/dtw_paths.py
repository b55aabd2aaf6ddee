"""Warps as in the paper: one DTW path on each relaxed block (section 3.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.sync.block_maps import BlockMaps
from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.sync.warp.positions import mass_within


def dtw_warps(
    relaxed: BlockMaps,
    soft_maps: BlockMaps,
    reference: int,
    fps: Sequence[float],
    params: SyncParams,
) -> tuple[list[Float[np.ndarray, "_T"]], list[Float[np.ndarray, "_T"]]]:
    """Positions of each video's frames in the reference by DTW, NaN unmatched, and confidences.

    Args:
        relaxed: affinities after cycle consistency; their negative is the cost.
        soft_maps: the confidence is their mass within `confidence_reach_s` of the path.
    """
    reach = params.confidence_reach_s * fps[reference]
    skip = _skip_cost(relaxed, reference, params.unmatched_level)
    positions, confidence = [], []
    for v in range(len(relaxed.blocks.lengths)):
        block = relaxed.block(v, reference)
        path, _ = dtw(-block, skip=skip)
        position = positions_of_rows(path, len(block))
        mass = mass_within(soft_maps.pair(v, reference), np.nan_to_num(position), reach)
        positions.append(position)
        confidence.append(np.where(np.isfinite(position), mass, 0.0))
    return positions, confidence


def _skip_cost(relaxed: BlockMaps, reference: int, unmatched_level: float) -> float:
    """Cost of an unmatched frame in DTW: minus the affinity at `unmatched_level` between best and
    typical entries."""
    if not np.isfinite(unmatched_level):
        return np.inf
    others = [v for v in range(len(relaxed.blocks.lengths)) if v != reference]
    maps = [relaxed.block(v, reference) for v in others]
    best = float(np.mean([np.median(b.max(axis=1)) for b in maps])) if maps else 1.0
    usual = float(np.mean([np.median(b) for b in maps])) if maps else 0.0
    return -(best + unmatched_level * (usual - best))
