"""Round trips: from a video to a second, on to a third, and back, by the most alike frames."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imocap_core.artifacts.schemas import Sync

Ints = NDArray[np.int64]

EXAMPLES = 5


def chosen_trip(sync: Sync) -> list[str]:
    """The reference and the two most central other videos that show the action; fewer if there
    are no more."""
    rank = dict(zip(sync.ids, sync.centrality, strict=True))
    others = [i for i in sync.ids if i != sync.reference and i not in sync.excluded]
    return [sync.reference, *sorted(others, key=lambda i: -rank[i])[:2]]


def round_trip(
    matrix: ArrayLike, ids: Sequence[str], lengths: Sequence[int], trip: Sequence[str]
) -> list[Ints]:
    """Where each frame of the first video of `trip` goes in each further one, and in the first
    again, by the strongest entry of each row of `matrix` (N, N), frames of all videos together."""
    entries = np.asarray(matrix)
    ends = np.cumsum(lengths)
    if entries.shape != (ends[-1], ends[-1]):
        raise ValueError(f"matrix: expected ({ends[-1]}, {ends[-1]}), got {entries.shape}")
    rows = {i: slice(e - n, e) for i, e, n in zip(ids, ends, lengths, strict=True)}
    at: list[Ints] = [np.arange(rows[trip[0]].stop - rows[trip[0]].start)]
    for here, there in pairwise([*trip, trip[0]]):
        step = entries[rows[here], rows[there]].argmax(axis=1)
        at.append(step[at[-1]])
    return at


def trips_of(sync: Sync, trip: Sequence[str]) -> tuple[list[Ints], list[Ints]]:
    """The round trip by the affinities alone, and after cycle consistency."""
    return (
        round_trip(sync.affinity, sync.ids, sync.lengths, trip),
        round_trip(sync.relaxed, sync.ids, sync.lengths, trip),
    )


def cycle_starts(sync: Sync, trip: Sequence[str]) -> list[int]:
    """Example frames of the first video, evenly over those that are matched in all of `trip`."""
    inside = np.ones(sync.lengths[sync.ids.index(trip[0])], dtype=bool)
    for found in (m for m in sync.maps if m.id in trip[1:]):
        at = found.reference_frame[np.isfinite(found.reference_frame)]
        if trip[0] == sync.reference and len(at):
            index = np.arange(len(inside))
            inside &= (index >= at.min()) & (index <= at.max())
    known = np.flatnonzero(inside) if inside.any() else np.arange(len(inside))
    wanted = np.linspace(0.08, 0.92, EXAMPLES) * (len(known) - 1)
    return [int(known[k]) for k in np.unique(np.rint(wanted).astype(int))]


def cycle_frames(sync: Sync, trip: Sequence[str], starts: Sequence[int]) -> dict[str, set[int]]:
    """Video -> the indices whose pictures `cycle_figure` shows."""
    before, after = trips_of(sync, trip)
    wanted: dict[str, set[int]] = {video: set() for video in trip}
    for video, at in zip([*trip, trip[0]], after, strict=True):
        wanted[video] |= {int(at[s]) for s in starts}
    wanted[trip[0]] |= {int(before[-1][s]) for s in starts}
    return wanted
