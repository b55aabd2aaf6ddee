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

_START, _DIAGONAL, _DOWN, _RIGHT = 0, 1, 2, 3


def _skewed(cost: np.ndarray) -> np.ndarray:
    """Anti-diagonals as rows: out[i + j, i] = cost[i, j]; infinite elsewhere."""
    n, m = cost.shape
    out = np.full((n, n + m), np.inf)
    for i in range(n):
        out[i, i : i + m] = cost[i]
    return np.ascontiguousarray(out.T[: n + m - 1])


def _accumulate(cost: np.ndarray, skip: float) -> tuple[np.ndarray, np.ndarray]:
    """Skewed accumulated cost and, for each cell, the step that leads to it; one anti-diagonal at
    a time."""
    n, m = cost.shape
    skew = _skewed(cost)
    step = np.zeros(skew.shape, dtype=np.uint8)
    total = np.full((n + m - 1, n), np.inf)
    # cost of the frames skipped before a path that starts in the cell
    start = np.full((n + m - 1, n), np.inf)
    start[0, 0] = 0.0
    if np.isfinite(skip):
        start[np.arange(m), 0] = skip * np.arange(m)
        start[np.arange(n), np.arange(n)] = skip * np.arange(n)
    total[0] = start[0] + 2.0 * skew[0]
    nothing = np.array([np.inf])
    before = np.full(n, np.inf)
    for d in range(1, n + m - 1):
        c = skew[d]
        diagonal = np.concatenate([nothing, before[:-1]]) + 2.0 * c
        down = np.concatenate([nothing, total[d - 1, :-1]]) + c
        right = total[d - 1] + c
        options = np.stack([start[d] + 2.0 * c, diagonal, down, right])
        step[d] = options.argmin(axis=0)
        total[d] = options.min(axis=0)
        before = total[d - 1]
    return total, step


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
    n, m = cost.shape
    missing = np.isnan(cost)
    if missing.any():
        valid = cost[~missing]
        cost = np.where(
            missing, skip if np.isfinite(skip) else (valid.mean() if valid.size else 0.0), cost
        )
    total, step = _accumulate(cost, skip)
    finish = np.full(total.shape, np.inf)
    finish[n + m - 2, n - 1] = 0.0
    if np.isfinite(skip):
        rows, columns = np.arange(n), np.arange(m)
        finish[rows + m - 1, rows] = skip * (n - 1 - rows)
        finish[n - 1 + columns, n - 1] = skip * (m - 1 - columns)
    ends = total + finish
    d, i = divmod(int(np.argmin(ends)), n)
    best = float(ends[d, i])
    path = [(i, d - i)]
    while d and step[d, i] != _START:
        taken = step[d, i]
        d, i = d - (2 if taken == _DIAGONAL else 1), i - (0 if taken == _RIGHT else 1)
        path.append((i, d - i))
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
    others = [v for v in range(len(relaxed.blocks.lengths)) if v != reference]
    maps = [relaxed.block(v, reference) for v in others]
    best = float(np.mean([np.median(b.max(axis=1)) for b in maps])) if maps else 1.0
    usual = float(np.mean([np.median(b) for b in maps])) if maps else 0.0
    return -(best + unmatched_level * (usual - best))
