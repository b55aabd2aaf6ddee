"""Squared distances between all frames of all videos, and their typical values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.sync.blocks import Blocks
from imocap_core.sync.pairwise.pose_change import pose_change
from imocap_core.sync.pairwise.poses import body_scales, joint_weights_of, stack
from imocap_core.sync.pairwise.procrustes import procrustes_distances
from imocap_core.sync.pairwise.vertical_motion import (
    of_one_amplitude,
    squared_differences,
    vertical_motion,
)

# pairs of frames of two videos that are all compared at first; of longer videos every n-th frame is
ALL_COMPARED = 1 << 22


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
    joint_weights: Float[np.ndarray, " J"] | None,
    fps: Sequence[float],
    params: SyncParams,
    *,
    heights: Sequence[Float[np.ndarray, "_T"]] | None = None,
    whole: bool = False,
) -> DistanceMatrix:
    """Compare the frames of every video with those of the others.

    Arguments as of `synchronise`; whole: every frame, also of long videos.
    """
    weights = joint_weights_of(poses, confidence, joint_weights)
    scales = body_scales(poses) if params.normalise_scale else np.ones(len(poses))
    least = params.least_difference_m**2
    scaled, blocks = stack(poses, scales)
    per_video = [scaled[blocks.rows(v)] for v in range(len(poses))]
    vertical = [np.full(len(x), np.nan) for x in poses]
    if heights is not None:
        moving = [vertical_motion(h / s, f) for h, s, f in zip(heights, scales, fps, strict=True)]
        vertical = of_one_amplitude(moving, params.least_difference_m)
    compared = ComparedPoints(per_video, weights, vertical)
    every = {pair: 1 if whole else _stride(*pair, blocks) for pair in blocks.pairs()}
    squares = {
        (i, j): compared.squares(i, j, slice(None, None, n), slice(None, None, n))
        for (i, j), n in every.items()
    }
    nearest, usual = [], []
    for block in squares.values():
        valid = block[np.isfinite(block).any(axis=1)]
        if valid.size:
            nearest.append(np.median(np.nanmin(valid, axis=1)))
            usual.append(np.nanmedian(valid))
    # identical clips have distance 0: the unit must stay positive
    unrelated = float(np.mean(usual)) if usual else 1.0
    matched = max(float(np.mean(nearest)), least, 1e-6 * unrelated, 1e-12) if nearest else 1.0
    change = [pose_change(x, w, f) for x, w, f in zip(per_video, weights, fps, strict=True)]
    return DistanceMatrix(
        per_video, weights, vertical, blocks, squares, every, compared, matched, unrelated, least,
        change,
    )  # fmt: skip


def _stride(i: int, j: int, blocks: Blocks) -> int:
    """The least n with which no more than ALL_COMPARED pairs of frames are compared."""
    n = 1
    while -(-blocks.lengths[i] // n) * -(-blocks.lengths[j] // n) > ALL_COMPARED:
        n += 1
    return n
