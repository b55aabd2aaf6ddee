"""Affinities of all pairs of frames (Eq. 1) for pictures: of long videos, every n-th frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from imocap_core.sync.pairwise.affinity import gaussian_affinity, reciprocal_affinity
from imocap_core.sync.pairwise.distance_matrix import DistanceMatrix

AFFINITIES = {"reciprocal": reciprocal_affinity, "gaussian": gaussian_affinity}
MOST_FRAMES = 500  # of a video


@dataclass(frozen=True)
class Affinities:
    """Of every n-th frame of each video.

    Attributes:
        every: n of each video.
        pairs: [i, j] with i < j: of the frames of video i and those of video j.
    """

    every: Sequence[int]
    pairs: Mapping[tuple[int, int], Float32[np.ndarray, "_A _B"]]

    def of_frames(self, pictures: Sequence[Int[np.ndarray, "_T"]]) -> Affinities:
        """Of frames that show pictures, from those of pictures; pictures: of each frame."""
        every = strides([len(p) for p in pictures])
        rows = [p[::n] // m for p, n, m in zip(pictures, every, self.every, strict=True)]
        pairs = {(i, j): part[np.ix_(rows[i], rows[j])] for (i, j), part in self.pairs.items()}
        return Affinities(every, pairs)


def strides(lengths: Sequence[int]) -> list[int]:
    """n of each video, from its number of frames."""
    return [max(1, -(-T // MOST_FRAMES)) for T in lengths]


def affinities(distances: DistanceMatrix, kind: str) -> Affinities:
    """By one of AFFINITIES."""
    every, scale = strides(distances.blocks.lengths), float(np.sqrt(distances.matched_square))
    pairs = {}
    for i, j in distances.blocks.pairs():
        shown = slice(None, None, every[i]), slice(None, None, every[j])
        distance = np.sqrt(distances.part(i, j, *shown))
        pairs[i, j] = AFFINITIES[kind](distance, scale).astype(np.float32)
    return Affinities(every, pairs)


def affinity_matrix(distances: DistanceMatrix, kind: str) -> Float[np.ndarray, "N_a N_a"]:
    """All frames of all videos, single precision; within a video the identity."""
    matrix = np.empty((distances.blocks.total,) * 2, dtype=np.float32)
    scale = float(np.sqrt(distances.matched_square))
    for i, j in distances.blocks.pairs():
        part = AFFINITIES[kind](np.sqrt(distances.part(i, j, slice(None), slice(None))), scale)
        distances.blocks.block(matrix, i, j)[...] = part
        distances.blocks.block(matrix, j, i)[...] = part.T
    distances.blocks.set_diagonal_to_identity(matrix)
    return matrix
