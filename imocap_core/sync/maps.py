"""Soft maps between all videos, one band a pair, and the block structure of Eq. 1.

Soft maps as bands: their entries vanish away from the warp. The posterior over monotone warps falls
off so fast that most entries of a row are lost in the rounding of any sum over it. Without them a
map takes memory, and a product with it time, in proportion to the frames, not to their square.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import DTypeLike


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


NEGLIGIBLE = 1e-24  # of a row's largest entry; sums are rounded at 1e-16
FRAMES = 32  # of a block; the positions of its band are those of any of its frames

Band = tuple[slice, slice]  # frames, positions


@dataclass(frozen=True)
class BandedMap:
    """A matrix of N frames and S positions that is zero outside a band.

    Attributes:
        bands: blocks of frames, in order, and the positions of each.
        values: the entries of each band.
    """

    shape: tuple[int, int]
    bands: Sequence[Band]
    values: Sequence[Float[np.ndarray, "_n _s"]]

    @classmethod
    def of(
        cls,
        soft_map: Float[np.ndarray, "N S"],
        negligible: float = NEGLIGIBLE,
        dtype: DTypeLike | None = None,
    ) -> BandedMap:
        """The map without what is negligible beside its row's largest entry, as type `dtype`."""
        N, S = soft_map.shape
        bands, values = [], []
        for rows in blocks_of_frames(N):
            block = soft_map[rows]
            columns = support(block, negligible)
            if columns is not None:
                bands.append((rows, columns))
                values.append(np.array(block[:, columns], dtype=dtype))
        return cls((N, S), bands, values)

    @classmethod
    def computed(
        cls,
        shape: tuple[int, int],
        bands: Sequence[Band],
        entries: Callable[[slice, slice], Float[np.ndarray, "_n _s"]],
    ) -> BandedMap:
        """The entries of given bands, computed band by band."""
        return cls(shape, bands, [entries(rows, columns) for rows, columns in bands])

    def __iter__(self) -> Iterator[tuple[slice, slice, Float[np.ndarray, "_n _s"]]]:
        """Frames, positions, entries of each band."""
        for (rows, columns), values in zip(self.bands, self.values, strict=True):
            yield rows, columns, values

    def dense(self, dtype: DTypeLike | None = None) -> Float[np.ndarray, "N S"]:
        """The whole matrix; of type `dtype`, by default that of the entries."""
        stored = self.values[0].dtype if self.values else np.dtype(float)
        out = np.zeros(self.shape, dtype=stored if dtype is None else dtype)
        for rows, columns, values in self:
            out[rows, columns] = values
        return out

    def mapped(self, change: Callable[[slice, slice, np.ndarray], np.ndarray]) -> BandedMap:
        """New entries in the same bands, from frames, positions and entries."""
        return BandedMap(self.shape, self.bands, [change(*part) for part in self])

    def trimmed(self, negligible: float = NEGLIGIBLE) -> BandedMap:
        """The map without what is negligible beside its row's largest entry, in bands of FRAMES."""
        bands, parts = [], []
        for rows, columns, values in self:
            for part in blocks_of_frames(rows.stop - rows.start):
                inside = support(values[part], negligible)
                if inside is not None:
                    frames = slice(rows.start + part.start, rows.start + part.stop)
                    first = columns.start
                    bands.append((frames, slice(first + inside.start, first + inside.stop)))
                    parts.append(values[part, inside].copy())
        return BandedMap(self.shape, bands, parts)

    def astype(self, dtype: DTypeLike) -> BandedMap:
        """The same in another precision."""
        return self.mapped(lambda rows, columns, values: values.astype(dtype))

    def scaled(self, factor: Float[np.ndarray, " N"]) -> BandedMap:
        """Every row times a number."""
        return self.mapped(lambda rows, _, values: values * factor[rows, None])

    def per_row(self, number: Callable[[np.ndarray], np.ndarray]) -> Float[np.ndarray, " N"]:
        """A number of each row from its entries, such as their sum; 0 where it has none."""
        out = np.zeros(self.shape[0])
        for rows, _, values in self:
            out[rows] = number(values)
        return out

    def row_sums(self) -> Float[np.ndarray, " N"]:
        """The sum of each row."""
        return self.per_row(lambda values: values.sum(axis=1))

    def largest(self) -> Int[np.ndarray, " N"]:
        """The position of each row's largest entry; 0 where a row has none."""
        out = np.zeros(self.shape[0], dtype=np.int64)
        for rows, columns, values in self:
            positions = columns.start + values.argmax(axis=1)
            out[rows] = np.where(values.max(axis=1) > 0, positions, 0)
        return out

    def gathered(self, values: Float[np.ndarray, "S F"]) -> Float[np.ndarray, "N F"]:
        """soft_map @ values: what each frame meets at its positions."""
        out = np.zeros((self.shape[0], values.shape[1]))
        for rows, columns, entries in self:
            out[rows] = entries @ values[columns]
        return out

    def spread(self, values: Float[np.ndarray, "N F"]) -> Float[np.ndarray, "S F"]:
        """soft_map.T @ values: what the frames bring to each position."""
        out = np.zeros((self.shape[1], values.shape[1]))
        for rows, columns, entries in self:
            out[columns] += entries.T @ values[rows]
        return out


def blocks_of_frames(N: int, size: int = FRAMES) -> Iterator[slice]:
    """Successive frames, so many at once; by default those of each band."""
    return (slice(first, min(first + size, N)) for first in range(0, N, size))


def support(block: Float[np.ndarray, "n S"], negligible: float) -> slice | None:
    """From the first to the last position that is not negligible to all rows; None: there is
    none."""
    entries = block > negligible * block.max(axis=1, keepdims=True)
    (positions,) = np.nonzero(entries.any(axis=0))
    return slice(int(positions[0]), int(positions[-1]) + 1) if len(positions) else None


def search_bands(maps: Sequence[BandedMap], reach: int) -> list[Band]:
    """Bands that contain those of all maps, and `reach` positions more to either side.

    Every frame has one; where no map has an entry, it is all positions.
    """
    N, S = maps[0].shape
    columns_of: dict[int, list[slice]] = {}
    for soft_map in maps:
        for rows, columns in soft_map.bands:
            columns_of.setdefault(rows.start, []).append(columns)
    bands = []
    for rows in blocks_of_frames(N):
        near = columns_of.get(rows.start)
        if near is None:
            bands.append((rows, slice(0, S)))
            continue
        first, stop = min(c.start for c in near), max(c.stop for c in near)
        bands.append((rows, slice(max(first - reach, 0), min(stop + reach, S))))
    return bands


def whole_band(matrix: Float[np.ndarray, "N S"]) -> BandedMap:
    """A matrix as one band of all its entries (not copied)."""
    N, S = matrix.shape
    return BandedMap((N, S), [(slice(0, N), slice(0, S))], [matrix])


def refined_bands(coarse: BandedMap, shape: tuple[int, int], n: int, reach: int) -> list[Band]:
    """Bands of all frames and positions, from a map of every n-th frame to every n-th position:
    those of the frames before, at and after, and `reach` positions more to either side."""
    places: dict[int, slice] = {}
    for rows, columns in coarse.bands:
        places.update(dict.fromkeys(range(rows.start, rows.stop), columns))
    bands = []
    for rows in blocks_of_frames(shape[0]):
        about = range(max(0, rows.start // n - 1), -(-rows.stop // n) + 1)
        near = [places[k] for k in about if k in places] or [slice(0, coarse.shape[1])]
        first = n * (min(c.start for c in near) - 1) - reach
        stop = n * (max(c.stop for c in near) + 1) + reach
        bands.append((rows, slice(max(0, first), min(shape[1], stop))))
    return bands


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
        cls, matrix: Float[np.ndarray, "N_a N_a"], blocks: Blocks, negligible: float = NEGLIGIBLE
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
