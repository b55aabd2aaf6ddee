"""Squared distances between all frames of all videos, and affinities from them (Eq. 1).

Paper, section 3.1: "we compute the Euclidean distance between each pair of 3D poses aligned by the
Procrustes method. Then, we map the reciprocal of distance to a value between [0,1]".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int

from imocap_core.params import SyncParams
from imocap_core.sync.comparable_poses import (
    body_scales,
    joint_weights_of,
    of_one_amplitude,
    of_one_mean,
    pose_change,
    squared_differences,
    stack,
    vertical_motion,
)
from imocap_core.sync.maps import Blocks
from imocap_core.sync.procrustes import procrustes_distances

# pairs of frames of two videos that are all compared at first; of longer videos every n-th frame is
ALL_COMPARED = 1 << 22
# Heights count in full where matching poses are apart by at least this share of the distance of
# unrelated ones: rope jumping and push-ups have 0.7, *yoga*, whose poses tell more, has 0.25.
INDISTINCT = 0.4


@dataclass(frozen=True)
class ComparedPoints:
    """What distances are computed from: joints and heights.

    Attributes:
        vertical: per video, its vertical motion.
    """

    points: Sequence[Float[np.ndarray, "_T P 3"]]
    weights: Sequence[Float[np.ndarray, "_T P"]]
    vertical: Sequence[Float[np.ndarray, "_T"]]

    def squares(self, i: int, j: int, rows: slice, columns: slice) -> Float[np.ndarray, "n m"]:
        """Squared distances of frames of video i to frames of video j."""
        distances = procrustes_distances(
            self.points[i][rows],
            self.points[j][columns],
            self.weights[i][rows],
            self.weights[j][columns],
        )
        lifted = squared_differences(self.vertical[i][rows], self.vertical[j][columns])
        return np.asarray(distances**2 + lifted)


@dataclass(frozen=True)
class DistanceMatrix:
    """All pairs of frames compared; of long videos every n-th frame, and others on demand.

    Attributes:
        poses, weights: per video, at the common body scale.
        vertical: per video, its vertical motion (`vertical_motion`), part of all distances.
        blocks: the videos' places among the N_a frames.
        squares: [i, j] with i < j: squared distances of every n-th frame of video i to every n-th
            of video j; NaN where unknown. n is 1 unless the videos are long.
        every: [i, j] with i < j: n.
        compared: what distances of further frames are computed from.
        matched_square: typical of matching frames.
        unrelated_square: typical of any two frames.
        least_square: squared distance below which performances are not told apart.
        change: per video, squared change of the pose around each frame.
    """

    poses: list[Float[np.ndarray, "_T J 3"]]
    weights: list[Float[np.ndarray, "_T J"]]
    vertical: list[Float[np.ndarray, "_T"]]
    blocks: Blocks
    squares: dict[tuple[int, int], Float[np.ndarray, "_N_i _N_j"]]
    every: dict[tuple[int, int], int]
    compared: ComparedPoints
    matched_square: float
    unrelated_square: float
    least_square: float
    change: list[Float[np.ndarray, "_T"]]

    @property
    def moving(self) -> list[Float[np.ndarray, "_T"]]:
        """Weight of each frame by how much its pose changes: 0 standing still, 1 moving."""
        return [np.asarray(-np.expm1(-change / self.matched_square)) for change in self.change]

    def block(self, i: int, j: int) -> Float[np.ndarray, "N_i N_j"]:
        """Squared distances of every n-th frame of video i to every n-th of video j (a view), with
        n as of `stride`; NaN within one video."""
        if i == j:
            return np.full((len(self.poses[i]),) * 2, np.nan)
        return self.squares[i, j] if i < j else self.squares[j, i].T

    def stride(self, i: int, j: int) -> int:
        """1 where all frames of two videos are compared, n where every n-th is."""
        return self.every.get((min(i, j), max(i, j)), 1)

    def part(self, i: int, j: int, rows: slice, columns: slice) -> Float[np.ndarray, "n m"]:
        """Squared distances of some frames of video i to some of video j."""
        if self.stride(i, j) == 1:
            return self.block(i, j)[rows, columns]
        return self.compared.squares(i, j, rows, columns)

    def with_squares_of(self, video: int) -> DistanceMatrix:
        """The same with squared distances to one video alone: the others' memory is freed."""
        squares = {pair: block for pair, block in self.squares.items() if video in pair}
        return replace(self, squares=squares)


def distance_matrix(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    confidence: Sequence[Float[np.ndarray, "_T J"]] | None,
    fps: Sequence[float],
    params: SyncParams,
    *,
    heights: Sequence[Float[np.ndarray, "_T"]] | None = None,
    whole: bool = False,
) -> DistanceMatrix:
    """Compare the frames of every video with those of the others.

    Arguments as of `synchronise`; whole: every frame, also of long videos.
    """
    weights = joint_weights_of(poses, confidence)
    scales = body_scales(poses)
    least = params.least_difference_m**2
    scaled, blocks = stack(poses, scales)
    per_video = of_one_mean([scaled[blocks.rows(v)] for v in range(len(poses))], weights)
    vertical = [np.full(len(x), np.nan) for x in poses]
    compared = ComparedPoints(per_video, weights, vertical)
    every = {pair: 1 if whole else _stride(*pair, blocks) for pair in blocks.pairs()}
    squares = {
        (i, j): compared.squares(i, j, slice(None, None, n), slice(None, None, n))
        for (i, j), n in every.items()
    }
    matched, unrelated = _typical_squares(squares, least)
    if heights is not None:
        moving = [vertical_motion(h / s, f) for h, s, f in zip(heights, scales, fps, strict=True)]
        weight = min(1.0, (matched / unrelated) ** 0.5 / INDISTINCT)
        vertical = [weight * h for h in of_one_amplitude(moving, params.least_difference_m)]
        compared = replace(compared, vertical=vertical)
        for (i, j), n in every.items():
            squares[i, j] += squared_differences(vertical[i][::n], vertical[j][::n])
        matched, unrelated = _typical_squares(squares, least)
    change = [pose_change(x, w, f) for x, w, f in zip(per_video, weights, fps, strict=True)]
    return DistanceMatrix(
        per_video, weights, vertical, blocks, squares, every, compared, matched, unrelated, least,
        change,
    )  # fmt: skip


def _typical_squares(
    squares: Mapping[tuple[int, int], Float[np.ndarray, "_ _"]], least: float
) -> tuple[float, float]:
    """Squared distances of matching frames, at least `least`, and of any two frames."""
    nearest, usual = [], []
    for block in squares.values():
        valid = block[np.isfinite(block).any(axis=1)]
        if valid.size:
            nearest.append(np.median(np.nanmin(valid, axis=1)))
            usual.append(np.nanmedian(valid))
    # identical clips have distance 0: the unit must stay positive
    unrelated = float(np.mean(usual)) if usual else 1.0
    matched = max(float(np.mean(nearest)), least, 1e-6 * unrelated, 1e-12) if nearest else 1.0
    return matched, unrelated


def _stride(i: int, j: int, blocks: Blocks) -> int:
    """The least n with which no more than ALL_COMPARED pairs of frames are compared."""
    n = 1
    while -(-blocks.lengths[i] // n) * -(-blocks.lengths[j] // n) > ALL_COMPARED:
        n += 1
    return n


def reciprocal_affinity(
    distance: Float[np.ndarray, "*shape"], scale: float
) -> Float[np.ndarray, "*shape"]:
    """The paper's map: the reciprocal of the distance, brought to [0, 1] as 1 / (1 + d / scale).

    1 at distance 0, 1/2 at `scale` (same unit as `distance`). Unknown distances (NaN) have
    affinity 0.
    """
    return np.nan_to_num(1.0 / (1.0 + distance / scale), nan=0.0)


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


def affinities(distances: DistanceMatrix) -> Affinities:
    """Of all pairs of videos (Eq. 1)."""
    every, scale = strides(distances.blocks.lengths), float(np.sqrt(distances.matched_square))
    pairs = {}
    for i, j in distances.blocks.pairs():
        shown = slice(None, None, every[i]), slice(None, None, every[j])
        distance = np.sqrt(distances.part(i, j, *shown))
        pairs[i, j] = reciprocal_affinity(distance, scale).astype(np.float32)
    return Affinities(every, pairs)


def affinity_matrix(distances: DistanceMatrix) -> Float[np.ndarray, "N_a N_a"]:
    """All frames of all videos, single precision; within a video the identity."""
    matrix = np.empty((distances.blocks.total,) * 2, dtype=np.float32)
    scale = float(np.sqrt(distances.matched_square))
    for i, j in distances.blocks.pairs():
        part = reciprocal_affinity(np.sqrt(distances.part(i, j, slice(None), slice(None))), scale)
        distances.blocks.block(matrix, i, j)[...] = part
        distances.blocks.block(matrix, j, i)[...] = part.T
    distances.blocks.set_diagonal_to_identity(matrix)
    return matrix
