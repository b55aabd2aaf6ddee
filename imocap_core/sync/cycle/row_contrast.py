"""How far a frame's best counterparts stand out from the usual ones.

The paper's reciprocal of the distance is far from 0 for unrelated poses too (1/3 is usual). Eq. 2
rewards every entry above alpha = 0.1, so such an affinity wants all frames matched with all others,
and the denoised matrix is flat. What tells is how far an entry stands out in its row.
"""

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.blocks import Blocks

Matrix = NDArray[np.floating]


def contrasted(maps: Matrix, blocks: Blocks) -> Matrix:
    """Every block's rows (of maps (N_a, N_a)) from 0, the row's median or less, to 1, its largest.

    A row without any contrast becomes 0: it says nothing. Own blocks are the identity. Sparse soft
    maps, whose median is 0, are only scaled.
    """
    out = np.zeros_like(maps)
    for i in range(len(blocks.lengths)):
        for j in range(len(blocks.lengths)):
            if i != j:
                block = np.asarray(blocks.block(maps, i, j))
                usual = np.median(block, axis=1, keepdims=True)
                room = block.max(axis=1, keepdims=True) - usual
                risen = np.maximum(block - usual, 0.0)
                blocks.block(out, i, j)[...] = risen / np.where(room > 1e-12, room, np.inf)
    blocks.set_diagonal_to_identity(out)
    return out
