"""The reference video: the medoid, to which the frames of the others are most similar."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.distance_matrix import DistanceMatrix


def centrality(
    distances: DistanceMatrix,
    soft_maps: Float[np.ndarray, "N_a N_a"],
    matched: Float[np.ndarray, "N_a M"],
) -> Float[np.ndarray, " M"]:
    """Centrality of each video, in [0, 1].

    The mean over the other videos' frames of P(it has a counterpart in the video) x similarity of
    that counterpart, exp(-d^2 / (2 matched_square)).

    Args:
        soft_maps: P(frame of another video | frame), one block per pair.
        matched: P(frame has a counterpart in a video).
    """
    M, blocks = len(distances.poses), distances.blocks
    out = np.ones(M)
    for v in range(M):
        shares = []
        for u in range(M):
            if u == v:
                continue
            square = np.nan_to_num(distances.block(u, v), nan=distances.unrelated_square)
            expected = (blocks.block(soft_maps, u, v) * square).sum(axis=1)
            similarity = np.exp(-0.5 * expected / distances.matched_square)
            shares.append(np.mean(matched[blocks.rows(u), v] * similarity))
        out[v] = np.mean(shares) if shares else 1.0
    return out


def most_central(centralities: Float[np.ndarray, " M"], eligible: Sequence[bool]) -> int:
    """Index of the eligible video of the largest centrality (of any video, if none is eligible)."""
    able = np.where(eligible, centralities, -1.0) if any(eligible) else centralities
    return int(np.argmax(able))
