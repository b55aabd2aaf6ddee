"""Affinities and soft maps of made synchronisations, as they are stored."""

from typing import TypedDict

import numpy as np

from imocap_core.adapters.sync_maps import stored_affinities, stored_maps
from imocap_core.artifacts.schemas import AffinityBlock, SoftMapBands
from imocap_core.sync.affinity import Affinities
from imocap_core.sync.maps import BlockMaps, Blocks


class StoredMatrix(TypedDict):
    """Two fields of `Sync`."""

    affinity: list[AffinityBlock]
    relaxed: SoftMapBands


def stored_matrix(matrix: np.ndarray, ids: list[str], lengths: list[int]) -> StoredMatrix:
    """One matrix (N, N) of all frames as affinities and as soft maps."""
    blocks = Blocks(tuple(lengths))
    pairs = {(i, j): np.float32(blocks.block(matrix, i, j)) for i, j in blocks.pairs()}
    return {
        "affinity": stored_affinities(Affinities([1] * len(ids), pairs), ids),
        "relaxed": stored_maps(BlockMaps.of(matrix, blocks)),
    }
