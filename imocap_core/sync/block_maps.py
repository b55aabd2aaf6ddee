"""Soft maps between all videos, one a pair, each as a band."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from jaxtyping import Float

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.pairwise.banded import NEGLIGIBLE, BandedMap


@dataclass(frozen=True)
class BlockMaps:
    """Maps from every video to every other one; within a video the identity.

    Attributes:
        pairs: [i, j]: from the frames of video i to those of video j; zeros for a missing pair.
    """

    blocks: Blocks
    pairs: Mapping[tuple[int, int], BandedMap]

    @classmethod
    def of(
        cls,
        matrix: Float[np.ndarray, "N_a N_a"],
        blocks: Blocks,
        negligible: float = NEGLIGIBLE,
    ) -> BlockMaps:
        """The blocks between different videos of a matrix of all frames, in single precision."""
        return cls(
            blocks,
            {
                (i, j): BandedMap.of(blocks.block(matrix, i, j), negligible, np.float32)
                for i, j in permutations(range(len(blocks.lengths)), 2)
            },
        )

    def pair(self, i: int, j: int) -> BandedMap:
        """From video i to video j."""
        if (i, j) in self.pairs:
            return self.pairs[i, j]
        shape = self.blocks.lengths[i], self.blocks.lengths[j]
        return BandedMap.of(np.eye(*shape) if i == j else np.zeros(shape), dtype=np.float32)

    def block(self, i: int, j: int) -> Float[np.ndarray, "N_i N_j"]:
        """The whole map from video i to video j."""
        return self.pair(i, j).dense(float)

    def dense(self) -> Float[np.ndarray, "N_a N_a"]:
        """All frames of all videos in one matrix, single precision."""
        matrix = np.zeros((self.blocks.total,) * 2, dtype=np.float32)
        for (i, j), soft_map in self.pairs.items():
            for rows, columns, values in soft_map:
                self.blocks.block(matrix, i, j)[rows, columns] = values
        self.blocks.set_diagonal_to_identity(matrix)
        return matrix
