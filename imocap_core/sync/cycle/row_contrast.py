"""Row contrast: how far each entry of a map stands out in its row, the affinity of Eq. 2.

The paper's reciprocal of the distance is far from 0 for unrelated poses too (1/3 is usual). Eq. 2
rewards every entry above alpha = 0.1, so with such an affinity it is best to match all frames with
all others, and the denoised matrix is flat. Informative is how far an entry stands out in its row.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.sync.blocks import Blocks


def row_contrast(
    maps: Float[np.ndarray, "N_a N_a"], blocks: Blocks
) -> Float[np.ndarray, "N_a N_a"]:
    """Scale every block's rows from 0, the row's median or less, to 1, its largest entry.

    A row without any contrast becomes 0 (no information). Blocks within a video are the identity.
    Sparse soft maps, whose median is 0, are only scaled.
    """
    out = np.zeros_like(maps)
    for i in range(len(blocks.lengths)):
        for j in range(len(blocks.lengths)):
            if i != j:
                block = blocks.block(maps, i, j)
                usual = np.median(block, axis=1, keepdims=True)
                room = block.max(axis=1, keepdims=True) - usual
                risen = np.maximum(block - usual, 0.0)
                blocks.block(out, i, j)[...] = risen / np.where(room > 1e-12, room, np.inf)
    blocks.set_diagonal_to_identity(out)
    return out


def symmetric_affinity(
    maps: Float[np.ndarray, "N_a N_a"], blocks: Blocks
) -> Float[np.ndarray, "N_a N_a"]:
    """One symmetric affinity in [0, 1] of directed soft maps: their row contrasts, both directions
    averaged."""
    contrast = row_contrast(maps, blocks)
    return np.asarray(0.5 * (contrast + contrast.T))
