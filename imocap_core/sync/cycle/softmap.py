"""Cycle consistency by composition of stochastic maps.

Each block of the affinity, its rows scaled to sum 1, is a stochastic map P_ij: the distribution of
a frame of video i over the frames of video j. Were the maps consistent, a composition through any
third video would not change them: P_ij = P_ik P_kj. So P_ij is replaced by the mean over all k of
P_ik P_kj, a few times. With P_ii = I the direct map counts twice (k = i and k = j). Only the bands
of the maps are multiplied.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
from jaxtyping import Float

from imocap_core.sync.block_maps import BlockMaps
from imocap_core.sync.cycle.report import CycleReport
from imocap_core.sync.pairwise.banded import BandedMap


def row_stochastic(soft_map: BandedMap) -> BandedMap:
    """Scale the rows to sum 1; a row of zeros becomes uniform (no information)."""
    total = soft_map.row_sums()
    if (total > 0).all():
        return soft_map.mapped(
            lambda rows, _, values: values / values.sum(axis=1, keepdims=True, dtype=values.dtype)
        )
    filled = soft_map.dense()
    filled[~(total > 0)] = 1.0
    return BandedMap.of(filled / filled.sum(axis=1, keepdims=True))


def row_information(soft_map: BandedMap) -> Float[np.ndarray, " N"]:
    """Information in each row of a stochastic map, in [0, 1]: 1 - entropy / log(number of frames).

    1 = the frame is located exactly, 0 = all frames of the other video are equally likely. A map
    that carries no information would otherwise blur every map composed through it.
    """
    N, S = soft_map.shape
    if S == 1:
        return np.ones(N)
    entropy = soft_map.per_row(lambda p: -(p * np.log(np.maximum(p, 1e-30))).sum(axis=1))
    return np.clip(1.0 - entropy / np.log(S), 1e-6, 1.0)


def softmap(maps: BlockMaps, *, rounds: int = 2) -> tuple[BlockMaps, CycleReport]:
    """Denoise affinities in [0, 1] by cycle consistency; returns row-stochastic maps.

    `rounds` >= 1 compositions, each composition weighted by the information of both maps
    (`row_information`). Works in float32: the maps are estimates of two digits at best and the
    products are the whole cost.
    """
    if rounds < 1:
        raise ValueError(f"rounds: expected at least 1, got {rounds}")
    every = list(permutations(range(len(maps.blocks.lengths)), 2))
    maps = BlockMaps(maps.blocks, {(i, j): row_stochastic(maps.pair(i, j)) for i, j in every})
    change = []
    for _ in range(rounds):
        weighted = {
            pair: m.scaled(row_information(m).astype(np.float32)) for pair, m in maps.pairs.items()
        }
        new, moved, size = {}, 0.0, float(maps.blocks.total)
        for pair in every:
            new[pair], squares = _compared(_composed(weighted, *pair), maps.pairs[pair])
            moved, size = moved + squares[0], size + squares[1]
        maps = BlockMaps(maps.blocks, new)
        change.append(float(np.sqrt(moved / size)))
    status = (
        f"softmap: {rounds} compositions, the last changed the maps by {100 * change[-1]:.1f} %"
    )
    return maps, CycleReport("softmap", True, tuple(change), status)


def _composed(weighted: dict[tuple[int, int], BandedMap], i: int, j: int) -> np.ndarray:
    """Sum (T_i, T_j) over all videos k of P_ik P_kj, i and j themselves included."""
    total: np.ndarray = 2 * weighted[i, j].dense()
    for k in {a for a, _ in weighted} - {i, j}:
        second = weighted[k, j]
        whole = second.dense()
        for rows, columns, values in weighted[i, k]:
            reached = [
                c for r, c in second.bands if r.start < columns.stop and columns.start < r.stop
            ]
            if reached:
                to = slice(min(c.start for c in reached), max(c.stop for c in reached))
                total[rows, to] += values @ whole[columns, to]
    return total


def _compared(total: np.ndarray, before: BandedMap) -> tuple[BandedMap, tuple[float, float]]:
    """The new map; squared norms of its difference from the one before, and of that."""
    new = row_stochastic(BandedMap.of(total))
    old = before.dense()
    size = float(np.linalg.norm(old)) ** 2
    old -= new.dense()
    return new, (float(np.linalg.norm(old)) ** 2, size)
