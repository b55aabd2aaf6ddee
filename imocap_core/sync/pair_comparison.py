"""Every video compared with every other one, pair by pair: soft maps and what is read from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import permutations

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.sync.block_maps import BlockMaps
from imocap_core.sync.map_consistency import PairMaps, map_of_pair
from imocap_core.sync.pairwise.banded import BandedMap
from imocap_core.sync.pairwise.distance_matrix import DistanceMatrix
from imocap_core.sync.reference import mean_similarity
from imocap_core.sync.warp.clocks import Clocks
from imocap_core.sync.warp.soft_maps import pairwise_soft_map


@dataclass(frozen=True)
class PairComparison:
    """Maps between all videos.

    Attributes:
        soft_maps: P(position in another video | frame).
        matched: P(frame has a counterpart in a video).
        pairs: medians of the soft maps.
        centralities: of each video, in [0, 1]: the mean over the other videos of
            `mean_similarity`.
    """

    soft_maps: BlockMaps
    matched: Float[np.ndarray, "N_a M"]
    pairs: PairMaps
    centralities: Float[np.ndarray, " M"]


def compared_pairs(distances: DistanceMatrix, clocks: Clocks, params: SyncParams) -> PairComparison:
    """One pair after another; soft maps are stored as bands, in single precision."""
    blocks, M = distances.blocks, len(distances.poses)
    matched, similarity = np.ones((blocks.total, M)), np.ones((M, M))
    soft_maps: dict[tuple[int, int], BandedMap] = {}
    positions, confidence = {}, {}
    for i, j in permutations(range(M), 2):
        soft_map, p_matched = pairwise_soft_map(i, j, distances, clocks, params)
        reach = params.confidence_reach_s * clocks.action_fps[j]
        positions[i, j], confidence[i, j] = map_of_pair(soft_map, p_matched, reach)
        soft_map = soft_map.trimmed()
        squares = partial(distances.part, i, j)
        similarity[i, j] = mean_similarity(soft_map, p_matched, squares, distances)
        matched[blocks.rows(i), j] = p_matched
        soft_maps[i, j] = soft_map.astype(np.float32)
    centralities = np.array(
        [np.mean(np.delete(similarity[:, v], v)) if M > 1 else 1.0 for v in range(M)]
    )
    return PairComparison(
        BlockMaps(blocks, soft_maps), matched, PairMaps(positions, confidence), centralities
    )
