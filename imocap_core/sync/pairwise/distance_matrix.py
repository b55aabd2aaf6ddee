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
from imocap_core.sync.pairwise.velocity import with_velocity


@dataclass(frozen=True)
class DistanceMatrix:
    """All pairs of frames compared.

    Attributes:
        poses, weights: per video, at the common body scale.
        blocks: the videos' places among the N_a frames.
        squares: [i, j] with i < j: squared distances of the frames of video i to those of video j;
            NaN where unknown.
        matched_square: typical of matching frames.
        unrelated_square: typical of any two frames.
        least_square: squared distance below which performances are not told apart.
        change: per video, squared change of the pose around each frame.
    """

    poses: list[Float[np.ndarray, "_T J 3"]]
    weights: list[Float[np.ndarray, "_T J"]]
    blocks: Blocks
    squares: dict[tuple[int, int], Float[np.ndarray, "_N_i _N_j"]]
    matched_square: float
    unrelated_square: float
    least_square: float
    change: list[Float[np.ndarray, "_T"]]

    def block(self, i: int, j: int) -> Float[np.ndarray, "N_i N_j"]:
        """Squared distances of the frames of video i to those of video j (a view); NaN within one
        video."""
        if i == j:
            return np.full((len(self.poses[i]),) * 2, np.nan)
        return self.squares[i, j] if i < j else self.squares[j, i].T

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
) -> DistanceMatrix:
    """Compare every frame of every video with every frame of the others.

    Arguments as of `synchronise`.
    """
    weights = joint_weights_of(poses, confidence, joint_weights)
    scales = body_scales(poses) if params.normalise_scale else np.ones(len(poses))
    least = params.least_difference_m**2
    scaled, blocks = stack(poses, scales)
    per_video = [scaled[blocks.rows(v)] for v in range(len(poses))]
    squares = _all_squares(per_video, weights, fps, blocks, params.velocity_weight_s)
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
    return DistanceMatrix(per_video, weights, blocks, squares, matched, unrelated, least, change)


def _all_squares(
    poses: Sequence[np.ndarray],
    weights: Sequence[np.ndarray],
    fps: Sequence[float],
    blocks: Blocks,
    velocity_weight_s: float,
) -> dict[tuple[int, int], np.ndarray]:
    """Squared distances between frames of different videos, one matrix a pair of videos."""
    points, point_weights = list(poses), list(weights)
    if velocity_weight_s > 0:
        for v, x in enumerate(poses):
            points[v], point_weights[v] = with_velocity(x, weights[v], fps[v], velocity_weight_s)
    # a mean over twice as many points, of which half are poses
    factor = 2.0 if velocity_weight_s > 0 else 1.0
    squares = {}
    for i, j in blocks.pairs():
        distances = procrustes_distances(points[i], points[j], point_weights[i], point_weights[j])
        squares[i, j] = factor * distances**2
    return squares
