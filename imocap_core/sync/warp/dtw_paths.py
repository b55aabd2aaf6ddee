"""Warps as in the paper: one DTW path on each relaxed block (section 3.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.sync.blocks import Blocks
from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.sync.warp.positions import mass_within


def dtw_warps(
    relaxed: Float[np.ndarray, "N_a N_a"],
    soft_maps: Float[np.ndarray, "N_a N_a"],
    blocks: Blocks,
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
    skip = _skip_cost(relaxed, blocks, reference, params.unmatched_level)
    positions, confidence = [], []
    for v in range(len(blocks.lengths)):
        block = np.asarray(blocks.block(relaxed, v, reference), dtype=float)
        path, _ = dtw(-block, skip=skip)
        position = positions_of_rows(path, len(block))
        mass = mass_within(blocks.block(soft_maps, v, reference), np.nan_to_num(position), reach)
        positions.append(position)
        confidence.append(np.where(np.isfinite(position), mass, 0.0))
    return positions, confidence


def _skip_cost(
    relaxed: np.ndarray, blocks: Blocks, reference: int, unmatched_level: float
) -> float:
    """Cost of an unmatched frame in DTW: minus the affinity at `unmatched_level` between best and
    typical entries."""
    if not np.isfinite(unmatched_level):
        return np.inf
    others = [v for v in range(len(blocks.lengths)) if v != reference]
    maps = [blocks.block(relaxed, v, reference) for v in others]
    best = float(np.mean([np.median(b.max(axis=1)) for b in maps])) if maps else 1.0
    usual = float(np.mean([np.median(b) for b in maps])) if maps else 0.0
    return -(best + unmatched_level * (usual - best))
