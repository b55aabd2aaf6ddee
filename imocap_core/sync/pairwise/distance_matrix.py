"""All pairs of frames compared, and the unit in which a distance is large."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.params import SyncParams
from imocap_core.sync.blocks import Blocks
from imocap_core.sync.pairwise.affinity import procrustes_distances
from imocap_core.sync.pairwise.poses import body_scales, joint_weights_of, stack
from imocap_core.sync.pairwise.velocity import with_velocity

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Comparison:
    """All pairs compared: squared distances, and what a matching and an unrelated pair typically
    have."""

    poses: list[Array]
    weights: list[Array]
    blocks: Blocks
    squares: Array
    near: float
    far: float
    floor: float  # squared distance below which performances are not told apart


def compare(
    poses: Sequence[Array],
    confidence: Sequence[Array] | None,
    joint_weights: Array | None,
    fps: Sequence[float],
    settings: SyncParams,
) -> Comparison:
    weights = joint_weights_of(poses, confidence, joint_weights)
    scales = body_scales(poses) if settings.normalise_scale else np.ones(len(poses))
    floor = settings.least_difference_m**2
    everything, blocks = stack(poses, scales)
    split = [everything[blocks.rows(v)] for v in range(len(poses))]
    squares = _all_squares(split, weights, fps, blocks, settings.velocity_weight_s)
    near, far = [], []
    for i, j in blocks.pairs():
        block = np.asarray(blocks.block(squares, i, j))
        known = block[np.isfinite(block).any(axis=1)]
        if known.size:
            near.append(np.median(np.nanmin(known, axis=1)))
            far.append(np.nanmedian(known))
    # identical clips have distance 0: keep the unit positive
    typical_far = float(np.mean(far)) if far else 1.0
    typical_near = max(float(np.mean(near)), floor, 1e-6 * typical_far, 1e-12) if near else 1.0
    return Comparison(split, weights, blocks, squares, typical_near, typical_far, floor)


def _all_squares(
    poses: Sequence[Array],
    weights: Sequence[Array],
    fps: Sequence[float],
    blocks: Blocks,
    velocity_weight_s: float,
) -> Array:
    """Squared distances (N_a, N_a) between frames of different videos; own blocks are NaN."""
    shown, counted = list(poses), list(weights)
    if velocity_weight_s > 0:
        for v, x in enumerate(poses):
            shown[v], counted[v] = with_velocity(x, weights[v], fps[v], velocity_weight_s)
    # a mean over twice as many points, of which half are poses
    points = 2.0 if velocity_weight_s > 0 else 1.0
    everything, stacked = np.concatenate(shown), np.concatenate(counted)
    squares = np.full((blocks.total, blocks.total), np.nan)
    for v in range(len(poses) - 1):
        rows = blocks.rows(v)
        rest = slice(rows.stop, None)
        distances = procrustes_distances(
            everything[rows], everything[rest], stacked[rows], stacked[rest]
        )
        squares[rows, rest] = points * distances**2
        squares[rest, rows] = squares[rows, rest].T
    return squares


def neighbour_squares(poses: Array, weights: Array) -> Array:
    """Squared Procrustes distance of each frame to the next, (T - 1,); 0 where unknown."""
    return np.array(
        [
            np.nan_to_num(
                procrustes_distances(
                    poses[t : t + 1],
                    poses[t + 1 : t + 2],
                    weights[t : t + 1],
                    weights[t + 1 : t + 2],
                )
            )[0, 0]
            ** 2
            for t in range(len(poses) - 1)
        ]
    )


def centrality_of(c: Comparison, maps: Array, matched: Array) -> Array:
    """How well each video stands for the others (M,) in [0, 1]: the mean over the other videos'
    frames of P(it has a counterpart here) x how close that counterpart is."""
    M = len(c.poses)
    out = np.ones(M)
    for v in range(M):
        shares = []
        for u in range(M):
            if u == v:
                continue
            square = np.nan_to_num(np.asarray(c.blocks.block(c.squares, u, v)), nan=c.far)
            expected = (np.asarray(c.blocks.block(maps, u, v)) * square).sum(axis=1)
            shares.append(np.mean(matched[c.blocks.rows(u), v] * np.exp(-0.5 * expected / c.near)))
        out[v] = np.mean(shares) if shares else 1.0
    return out
