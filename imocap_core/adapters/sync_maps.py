"""Affinities and soft maps as they are stored, and back."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import AffinityBlock, SoftMapBands, Sync
from imocap_core.sync.affinity import Affinities
from imocap_core.sync.maps import Band, BandedMap, BlockMaps, Blocks, blocks_of_frames

LARGEST = 65535  # the integer of an affinity of 1
LEFT_OUT = 1e-4  # of a row's largest entry: what lies beyond it is not stored


def stored_affinities(affinities: Affinities, ids: list[str]) -> list[AffinityBlock]:
    """One a pair; ids: of the videos, in their order."""
    return [
        AffinityBlock(
            first=ids[i],
            second=ids[j],
            every=np.array([affinities.every[i], affinities.every[j]]),
            scaled=np.rint(LARGEST * np.clip(part, 0.0, 1.0)).astype(np.uint16),
        )
        for (i, j), part in affinities.pairs.items()
    ]


def stored_maps(maps: BlockMaps) -> SoftMapBands:
    """The bands of all pairs, without what is below LEFT_OUT of a row's largest entry."""
    position, width, entries = [], [], [np.zeros(0, dtype=np.float32)]
    for i, j in permutations(range(len(maps.blocks.lengths)), 2):
        narrow = {r.start: (c, x) for r, c, x in maps.pair(i, j).trimmed(LEFT_OUT)}
        for rows in blocks_of_frames(maps.blocks.lengths[i]):
            columns, values = narrow.get(rows.start, (slice(0, 0), np.zeros((0, 0))))
            position.append(columns.start)
            width.append(columns.stop - columns.start)
            entries.append(values.astype(np.float32).ravel())
    return SoftMapBands(
        position=np.array(position, dtype=np.int64),
        width=np.array(width, dtype=np.int64),
        entries=np.concatenate(entries),
    )


def maps_of(sync: Sync) -> BlockMaps:
    """The soft maps between all videos of a synchronisation, in the order of its ids."""
    blocks, stored = Blocks(tuple(sync.lengths)), sync.relaxed
    pairs, band, entry = {}, 0, 0
    for i, j in permutations(range(len(sync.lengths)), 2):
        bands: list[Band] = []
        values = []
        for rows in blocks_of_frames(sync.lengths[i]):
            first, width = int(stored.position[band]), int(stored.width[band])
            size = width * (rows.stop - rows.start)
            if width:
                bands.append((rows, slice(first, first + width)))
                values.append(stored.entries[entry : entry + size].reshape(-1, width))
            band, entry = band + 1, entry + size
        pairs[i, j] = BandedMap((sync.lengths[i], sync.lengths[j]), bands, values)
    return BlockMaps(blocks, pairs)


def affinity_between(
    sync: Sync, first: str, second: str
) -> tuple[Float[np.ndarray, "A B"], tuple[int, int]]:
    """Affinities of two videos' frames, of every n-th of each, and n of either; zeros of a video
    that is excluded."""
    for block in sync.affinity:
        n, m = (int(x) for x in block.every)
        values = block.scaled / LARGEST
        if (block.first, block.second) == (first, second):
            return values, (n, m)
        if (block.first, block.second) == (second, first):
            return values.T, (m, n)
    lengths = dict(zip(sync.ids, sync.lengths, strict=True))
    return np.zeros((lengths[first], lengths[second])), (1, 1)
