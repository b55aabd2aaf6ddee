"""The block structure of Eq. 1: all frames of all videos in one matrix, one block per pair of
videos."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Blocks:
    """Where each video's frames lie among all N_a frames; `lengths` (M,) frames of each video."""

    lengths: tuple[int, ...]

    @property
    def total(self) -> int:
        """N_a, the number of frames of all videos."""
        return sum(self.lengths)

    def rows(self, v: int) -> slice:
        """The rows (and columns) of video v."""
        start = sum(self.lengths[:v])
        return slice(start, start + self.lengths[v])

    def block(
        self, matrix: Float[np.ndarray, "N_a N_a"], i: int, j: int
    ) -> Float[np.ndarray, "N_i N_j"]:
        """The view of videos i and j in a matrix."""
        return matrix[self.rows(i), self.rows(j)]

    def pairs(self) -> Iterator[tuple[int, int]]:
        """All i < j."""
        M = len(self.lengths)
        return ((i, j) for i in range(M) for j in range(i + 1, M))

    def set_diagonal_to_identity(self, matrix: Float[np.ndarray, "N_a N_a"]) -> None:
        """Every frame matches itself and no other frame of its video (in place)."""
        for v in range(len(self.lengths)):
            self.block(matrix, v, v)[...] = np.eye(self.lengths[v], dtype=matrix.dtype)
