"""Round trips: from a video to a second, to a third and back, by the most similar frames."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from imocap_core.artifacts.schemas import Sync

Positions = Int[np.ndarray, " T"]  # where each frame of the trip's first video is

EXAMPLES = 5


def chosen_trip(sync: Sync) -> list[str]:
    """The reference and the two most central other videos that are not excluded, or fewer."""
    rank = dict(zip(sync.ids, sync.centrality, strict=True))
    others = [i for i in sync.ids if i != sync.reference and i not in sync.excluded]
    return [sync.reference, *sorted(others, key=lambda i: -rank[i])[:2]]


def round_trip(
    matrix: Float[np.ndarray, "N N"],
    ids: Sequence[str],
    lengths: Sequence[int],
    trip: Sequence[str],
) -> list[Positions]:
    """Position of each frame of the first video of `trip` in each video of the trip, and in the
    first again, by the largest entry of each row of `matrix`.

    Args:
        matrix: similarity of all frames of all videos, in the order of `ids`.
        lengths: number of frames of each video.

    Raises:
        ValueError: the matrix does not have the size of all frames together.
    """
    ends = np.cumsum(lengths)
    if matrix.shape != (ends[-1], ends[-1]):
        raise ValueError(f"matrix: expected ({ends[-1]}, {ends[-1]}), got {matrix.shape}")
    rows = {i: slice(e - n, e) for i, e, n in zip(ids, ends, lengths, strict=True)}
    positions: list[Positions] = [np.arange(rows[trip[0]].stop - rows[trip[0]].start)]
    for here, there in pairwise([*trip, trip[0]]):
        step = matrix[rows[here], rows[there]].argmax(axis=1)
        positions.append(step[positions[-1]])
    return positions


def trips_of(sync: Sync, trip: Sequence[str]) -> tuple[list[Positions], list[Positions]]:
    """The round trip by the affinities alone, and after cycle consistency."""
    return (
        round_trip(sync.affinity, sync.ids, sync.lengths, trip),
        round_trip(sync.relaxed, sync.ids, sync.lengths, trip),
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
