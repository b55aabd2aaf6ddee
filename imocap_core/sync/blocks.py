"""The block structure of Eq. 1: all frames of all videos in one matrix, one block per pair of
videos."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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

    def block(self, matrix: NDArray[np.floating], i: int, j: int) -> NDArray[np.floating]:
        """The view (N_i, N_j) of videos i and j in a matrix (N_a, N_a)."""
        return matrix[self.rows(i), self.rows(j)]

    def pairs(self) -> Iterator[tuple[int, int]]:
        """All i < j."""
        M = len(self.lengths)
        return ((i, j) for i in range(M) for j in range(i + 1, M))

    def set_diagonal_to_identity(self, matrix: NDArray[np.floating]) -> None:
        """Every frame matches itself and no other frame of its own video (in place)."""
        for v in range(len(self.lengths)):
            self.block(matrix, v, v)[...] = np.eye(self.lengths[v], dtype=matrix.dtype)
