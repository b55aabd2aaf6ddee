"""Videos of one event: when each began, by their sound, as hints for the synchronisation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import Keypoints, VideoKeypoints
from imocap_core.io.sound import read_sound
from imocap_core.sync import Anchor, Hints
from imocap_core.sync.sound import (
    RATE_HZ,
    PairOffset,
    consistent_offsets,
    onset_envelope,
    pair_offsets,
)

ANCHOR_EVERY_S, MOST_ANCHORS = 0.1, 40  # between two videos
EDGE_S = 0.1  # of the overlap, without anchors


@dataclass(frozen=True)
class EventSound:
    """start_s: when each video began, NaN where its sound does not tell; notes: sentences."""

    start_s: Float[np.ndarray, " M"]
    notes: list[str]


def event_sound(files: Mapping[str, Path | None], keypoints: Keypoints) -> EventSound:
    """What the sound of the videos of one event tells.

    Args:
        files: by video, None where there is none.
    """
    ids = [video.id for video in keypoints.videos]
    envelopes: list[Float[np.ndarray, " _"] | None] = []
    for video in ids:
        file = files.get(video)
        samples = None if file is None or not file.is_file() else read_sound(file, RATE_HZ)
        envelopes.append(None if samples is None else onset_envelope(samples))
    pairs = pair_offsets(envelopes)
    start_s = consistent_offsets(pairs, len(ids))
    silent = [i for i, e in zip(ids, envelopes, strict=True) if e is None or not e.any()]
    return EventSound(start_s, _notes(ids, silent, pairs, start_s))


def with_sound(hints: Hints, start_s: Float[np.ndarray, " M"], keypoints: Keypoints) -> Hints:
    """The hints and, between every two videos whose offset is known, soft anchors; what the user
    has anchored in two videos stays as it is."""
    anchored = {frozenset((anchor.a, anchor.b)) for anchor in hints.anchors}
    ties: list[Anchor] = []
    for a, b in combinations(range(len(keypoints.videos)), 2):
        if np.isfinite(start_s[[a, b]]).all() and frozenset((a, b)) not in anchored:
            first, second = keypoints.videos[a], keypoints.videos[b]
            ties += _anchors(a, first, b, second, float(start_s[b] - start_s[a]))
    forbidden = hints.forbidden_frames([len(v.frames) for v in keypoints.videos])
    free = [
        x for x in ties
        if not forbidden[x.a][x.frame_a] and not forbidden[x.b][round(x.frame_b)]
    ]  # fmt: skip
    return replace(hints, anchors=(*hints.anchors, *free))


def _anchors(
    a: int, first: VideoKeypoints, b: int, second: VideoKeypoints, offset_s: float
) -> list[Anchor]:
    """Anchors at equal intervals over what both videos show."""
    begin = max(first.time_s[0], second.time_s[0] + offset_s) + EDGE_S
    end = min(first.time_s[-1], second.time_s[-1] + offset_s) - EDGE_S
    ties = []
    for time in np.arange(begin, end, max(ANCHOR_EVERY_S, (end - begin) / MOST_ANCHORS)):
        frame = int(np.abs(first.time_s - time).argmin())
        counterpart = np.interp(
            first.time_s[frame] - offset_s, second.time_s, np.arange(len(second.time_s))
        )
        ties.append(Anchor(a, frame, b, float(counterpart)))
    return ties


def _notes(
    ids: list[str],
    silent: list[str],
    pairs: Mapping[tuple[int, int], PairOffset],
    start_s: Float[np.ndarray, " M"],
) -> list[str]:
    notes = []
    tied = [v for v in range(len(ids)) if np.isfinite(start_s[v])]
    if tied:
        first = tied[0]
        begun = ", ".join(f"{ids[v]} {start_s[v] - start_s[first]:+.2f} s" for v in tied[1:])
        notes.append(f"by their sound, against the beginning of {ids[first]}: {begun}")
    if silent:
        notes.append(f"{', '.join(silent)}: no sound, so the pictures alone tell the timing")
    for (a, b), pair in pairs.items():
        if a in tied and b in tied:
            continue
        names = f"{ids[a]} and {ids[b]}"
        if pair.common:
            notes.append(
                f"{names}: their sound repeats itself (offsets of {pair.offset_s:+.2f} s and "
                f"{pair.other_s:+.2f} s fit nearly alike), so it is not used"
            )
        else:
            notes.append(f"{names}: no sound in common is recognised, so it is not used")
    return notes
