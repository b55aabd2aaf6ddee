"""What is stored beside the maps of made synchronisations: affinities, soft maps, trust."""

from collections.abc import Mapping
from typing import Any, TypedDict

import numpy as np

from imocap_core.adapters.sync_maps import stored_affinities, stored_maps
from imocap_core.artifacts.schemas import AffinityBlock, SoftMapBands, SyncTrust, VideoTrust
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


def trust_in(phases: Mapping[str, np.ndarray], **fields: Any) -> SyncTrust:
    """Every video's phases, seconds; they agree as well as they can unless fields say otherwise."""
    agrees = ("outlier_score", "mirror_margin", "left_out_frames", "left_out_s")
    fields = {**dict.fromkeys(agrees, 0.0), "left_out_share": 1.0, **fields}
    videos = [VideoTrust(id=i, phase_s=phase, **fields) for i, phase in phases.items()]
    return SyncTrust(videos=videos, triples=[])
