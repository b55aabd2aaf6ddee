"""Round trips: from a video to a second, to a third and back, by the most similar frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Int

from imocap_core.artifacts.schemas import Sync
from imocap_core.problem.sync_maps import maps_of, nearest_by_affinity

Positions = Int[np.ndarray, " T"]  # where each frame of the trip's first video is

EXAMPLES = 5


def chosen_trip(sync: Sync) -> list[str]:
    """The reference and the two most central other videos that are not excluded, or fewer."""
    rank = dict(zip(sync.ids, sync.centrality, strict=True))
    others = [i for i in sync.ids if i != sync.reference and i not in sync.excluded]
    return [sync.reference, *sorted(others, key=lambda i: -rank[i])[:2]]


def round_trip(nearest: Callable[[str, str], Positions], trip: Sequence[str]) -> list[Positions]:
    """Position of each frame of the first video of `trip` in each video of the trip, and in the
    first again.

    Args:
        nearest: the most similar frame of a second video for each frame of a first.
    """
    steps = [nearest(here, there) for here, there in pairwise([*trip, trip[0]])]
    positions: list[Positions] = [np.arange(len(steps[0]))]
    for step in steps:
        positions.append(step[positions[-1]])
    return positions


def trips_of(sync: Sync, trip: Sequence[str]) -> tuple[list[Positions], list[Positions]]:
    """The round trip by the affinities alone, and after cycle consistency."""
    maps, number = maps_of(sync), {name: v for v, name in enumerate(sync.ids)}
    return (
        round_trip(lambda a, b: nearest_by_affinity(sync, a, b), trip),
        round_trip(lambda a, b: maps.pair(number[a], number[b]).largest(), trip),
    )


def cycle_starts(sync: Sync, trip: Sequence[str]) -> list[int]:
    """Example frames of the first video, evenly over those matched in all videos of `trip`."""
    inside = np.ones(sync.lengths[sync.ids.index(trip[0])], dtype=bool)
    for sync_map in (m for m in sync.maps if m.id in trip[1:]):
        matched = sync_map.reference_frame[np.isfinite(sync_map.reference_frame)]
        if trip[0] == sync.reference and len(matched):
            index = np.arange(len(inside))
            inside &= (index >= matched.min()) & (index <= matched.max())
    frames = np.flatnonzero(inside) if inside.any() else np.arange(len(inside))
    examples = np.linspace(0.08, 0.92, EXAMPLES) * (len(frames) - 1)
    return [int(frames[k]) for k in np.unique(np.rint(examples).astype(int))]


def cycle_frames(sync: Sync, trip: Sequence[str], starts: Sequence[int]) -> dict[str, set[int]]:
    """Video -> the indices whose pictures `cycle_figure` shows."""
    before, after = trips_of(sync, trip)
    shown: dict[str, set[int]] = {video: set() for video in trip}
    for video, positions in zip([*trip, trip[0]], after, strict=True):
        shown[video] |= {int(positions[s]) for s in starts}
    shown[trip[0]] |= {int(before[-1][s]) for s in starts}
    return shown
