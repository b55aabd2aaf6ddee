"""Cycle consistency by composition of stochastic maps.

Each block of the affinity, its rows scaled to sum 1, is a stochastic map P_ij: the distribution of
a frame of video i over the frames of video j. Were the maps consistent, a composition through any
third video would not change them: P_ij = P_ik P_kj. So P_ij is replaced by the mean over all k of
P_ik P_kj, a few times. With P_ii = I the direct map counts twice (k = i and k = j). All blocks
together are one matrix product.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.cycle.report import CycleReport


def row_stochastic(
    matrix: Float[np.ndarray, "N_a N_a"], blocks: Blocks
) -> Float[np.ndarray, "N_a N_a"]:
    """Scale the rows of every block to sum 1; a row of zeros becomes uniform (no information)."""
    out = matrix.copy()
    for v, length in enumerate(blocks.lengths):
        part = out[:, blocks.rows(v)]
        total = part.sum(axis=1, keepdims=True)
        part[...] = np.where(
            total > 0, part / np.where(total > 0, total, 1.0), 1.0 / max(length, 1)
        )
    return out


def row_information(
    maps: Float[np.ndarray, "N_a N_a"], blocks: Blocks
) -> Float[np.ndarray, "N_a M"]:
    """Information in each row of each block, in [0, 1]: 1 - entropy / log(number of frames).

    1 = the frame is located exactly, 0 = all frames of the other video are equally likely. A block
    that carries no information would otherwise blur every map composed through it.
    """
    out = np.empty((len(maps), len(blocks.lengths)), dtype=maps.dtype)
    for v, length in enumerate(blocks.lengths):
        part = maps[:, blocks.rows(v)]
        entropy = -(part * np.log(np.maximum(part, 1e-30))).sum(axis=1)
        out[:, v] = 1.0 - entropy / np.log(length) if length > 1 else 1.0
    return np.clip(out, 1e-6, 1.0)


def softmap(
    affinity: Float[np.ndarray, "N_a N_a"], blocks: Blocks, *, rounds: int = 2
) -> tuple[Float[np.ndarray, "N_a N_a"], CycleReport]:
    """Denoise an affinity in [0, 1] by cycle consistency; returns row-stochastic maps.

    `rounds` >= 1 compositions, each composition weighted by the information of both maps
    (`row_information`). Works in float32: the maps are estimates of two digits at best and the
    product is the whole cost.
    """
    if rounds < 1:
        raise ValueError(f"rounds: expected at least 1, got {rounds}")
    maps = affinity.astype(np.float32)
    blocks.set_diagonal_to_identity(maps)
    maps = row_stochastic(maps, blocks)
    change = []
    for _ in range(rounds):
        weighted = maps * np.repeat(row_information(maps, blocks), blocks.lengths, axis=1)
        new = weighted @ weighted
        blocks.set_diagonal_to_identity(new)
        new = row_stochastic(new, blocks)
        change.append(float(np.linalg.norm(new - maps) / np.linalg.norm(maps)))
        maps = new
    status = (
        f"softmap: {rounds} compositions, the last changed the maps by {100 * change[-1]:.1f} %"
    )
    return maps, CycleReport("softmap", True, tuple(change), status)
