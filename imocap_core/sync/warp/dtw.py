"""Dynamic time warping with open ends, and the paper's last step: a path on each relaxed block.

A path runs monotonically through the cost matrix. Every frame of either video pays once: the cost
of the cell it is matched in, or `skip` when it lies before the path's start or after its end. A
diagonal step therefore weighs two (a frame of each video), a straight step one; swapping the
videos transposes the path. An infinite `skip` closes the ends.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from imocap_core.params import SyncParams
from imocap_core.sync.maps import BlockMaps
from imocap_core.sync.warp.template import mass_within
from imocap_core.workers import compiled

_START, _DIAGONAL, _DOWN, _RIGHT = 0, 1, 2, 3


@compiled
def _accumulate(cost, skip):  # type: ignore[no-untyped-def]
    """The step that leads to each cell (n, m), the last cell of the cheapest path, and its cost.

    Of equally cheap ends that on the earliest anti-diagonal, there in the earliest row.
    """
    n, m = cost.shape
    step, total, open_ends = np.empty((n, m), np.uint8), np.full(m, np.inf), np.isfinite(skip)
    row, column, best = 0, 0, np.inf
    for i in range(n):
        corner = left = np.inf  # totals of the row before and of this one, a column back
        for j in range(m):
            here, value, taken = cost[i, j], np.inf, _START
            if (i == 0 or j == 0) and (open_ends or i + j == 0):
                value = (skip * (i + j) if i + j else 0.0) + 2.0 * here
            if corner + 2.0 * here < value:
                value, taken = corner + 2.0 * here, _DIAGONAL
            if total[j] + here < value:
                value, taken = total[j] + here, _DOWN
            if left + here < value:
                value, taken = left + here, _RIGHT
            corner, left = total[j], value
            total[j], step[i, j] = value, taken
            rest = (n - 1 - i) + (m - 1 - j)
            if (i == n - 1 or j == m - 1) and (open_ends or rest == 0):
                value += skip * rest if rest else 0.0
                if value < best or (value == best and i + j < row + column):
                    row, column, best = i, j, value
    return step, row, column, best


def dtw(
    cost: Float[np.ndarray, "N S"], *, skip: float = np.inf
) -> tuple[Int[np.ndarray, "L 2"], float]:
    """The cheapest monotone path through a cost matrix, as index pairs, and its total cost.

    Args:
        cost: NaN costs count as `skip` (or as the mean cost when ends are closed).
        skip: cost of an unmatched frame before the path's start or after its end; inf = the path
            must run from the first pair of frames to the last.

    Raises:
        ValueError: cost is no matrix, or has no entries.
    """
    if cost.ndim != 2 or 0 in cost.shape:
        raise ValueError(f"cost: expected a matrix (n, m) with n, m >= 1, got shape {cost.shape}")
    missing = np.isnan(cost)
    if missing.any():
        usual = 0.0 if missing.all() else cost[~missing].mean()
        cost = np.where(missing, skip if np.isfinite(skip) else usual, cost)
    step, i, j, best = _accumulate(cost, skip)
    path = [(i, j)]
    while i + j and step[i, j] != _START:
        taken = step[i, j]
        i, j = i - (taken != _RIGHT), j - (taken != _DOWN)
        path.append((i, j))
    return np.array(path[::-1], dtype=np.int64), best


def positions_of_rows(path: Int[np.ndarray, "L 2"], n: int) -> Float[np.ndarray, " n"]:
    """Position of each of n rows in the columns: the mean column of its path cells; NaN off the
    path."""
    count = np.bincount(path[:, 0], minlength=n)
    total = np.bincount(path[:, 0], weights=path[:, 1], minlength=n)
    return np.divide(total, count, out=np.full(n, np.nan), where=count > 0)


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
    videos = range(len(relaxed.blocks.lengths))
    maps = [relaxed.block(v, reference) for v in videos if v != reference]
    best = float(np.mean([np.median(b.max(axis=1)) for b in maps])) if maps else 1.0
    usual = float(np.mean([np.median(b) for b in maps])) if maps else 0.0
    return -(best + unmatched_level * (usual - best))
