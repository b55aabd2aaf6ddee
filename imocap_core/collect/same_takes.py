"""Occurrences that show one take: groups of them, and the one of each group that stays."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from imocap_core.collect.choice import SameTakeAs
from imocap_core.collect.films import pictures_of
from imocap_core.collect.occurrences import Occurrence
from imocap_core.collect.replays import (
    ALIKE,
    Replay,
    compared_pairs,
    repeated_motion,
    same_picture,
)
from imocap_core.collect.tracks import ShotTrack

Pair = tuple[int, int]
Pictures = dict[int, dict[int, UInt8[np.ndarray, "H W"]]]  # by film and frame


def showings(
    occurrences: Sequence[Occurrence],
    tracks: Sequence[ShotTrack],
    films: Sequence[Path],
    twins: Sequence[int],
) -> dict[int, SameTakeAs]:
    """Occurrences that show a take again, by index, and the better showing that stays.

    Args:
        tracks: of the occurrences, the person in the whole shot.
        films: the files. twins: each keypoint's left-right counterpart.
    """
    suspects: dict[Pair, Replay] = {}
    for i, k in combinations(range(len(occurrences)), 2):
        replay = _either_way(i, k, occurrences, tracks, twins)
        if replay is not None:
            suspects[replay[0]] = replay[1]
    pictures = _pictures(suspects, occurrences, tracks, films)
    same = {
        pair: replay
        for pair, replay in suspects.items()
        if _alike(pair, replay, occurrences, tracks, pictures) >= ALIKE
    }
    return _groups(occurrences, same)


def shows_again(first: ShotTrack, second: ShotTrack, twins: Sequence[int]) -> bool:
    """Whether the one track has all the moving keypoints of the other."""
    pairs = ((first, second), (second, first))
    return any(repeated_motion(a.xy_px, b.xy_px, a.fps, twins) is not None for a, b in pairs)


def _either_way(
    i: int,
    k: int,
    occurrences: Sequence[Occurrence],
    tracks: Sequence[ShotTrack],
    twins: Sequence[int],
) -> tuple[Pair, Replay] | None:
    """The pair and its replay: all of the one in the other, or the other way round."""
    if (occurrences[i].film, occurrences[i].shot) == (occurrences[k].film, occurrences[k].shot):
        return None
    for a, b in ((i, k), (k, i)):
        replay = repeated_motion(
            _keypoints(occurrences[a], tracks[a]), tracks[b].xy_px, tracks[a].fps, twins
        )
        if replay is not None:
            return (a, b), replay
    return None


def _keypoints(occurrence: Occurrence, track: ShotTrack) -> np.ndarray:
    """The keypoints of the occurrence's frames."""
    return track.xy_px[occurrence.first - track.first : occurrence.stop - track.first]


def _frames(
    pair: Pair, replay: Replay, occurrences: Sequence[Occurrence], tracks: Sequence[ShotTrack]
) -> list[tuple[int, int]]:
    """Corresponding frames of both films."""
    first, second = occurrences[pair[0]].first, tracks[pair[1]].first
    return [(first + a, second + b) for a, b in compared_pairs(replay)]


def _pictures(
    suspects: dict[Pair, Replay],
    occurrences: Sequence[Occurrence],
    tracks: Sequence[ShotTrack],
    films: Sequence[Path],
) -> Pictures:
    wanted: dict[int, set[int]] = defaultdict(set)
    for pair, replay in suspects.items():
        for a, b in _frames(pair, replay, occurrences, tracks):
            wanted[occurrences[pair[0]].film].add(a)
            wanted[occurrences[pair[1]].film].add(b)
    return {film: pictures_of(films[film], frames) for film, frames in wanted.items()}


def _alike(
    pair: Pair,
    replay: Replay,
    occurrences: Sequence[Occurrence],
    tracks: Sequence[ShotTrack],
    pictures: Pictures,
) -> float:
    """Median correlation of the pictures of the person in corresponding frames."""
    first, second = (occurrences[i] for i in pair)
    track = tracks[pair[0]]
    values = []
    for a, b in _frames(pair, replay, occurrences, tracks):
        box = track.box_px[a - track.first]
        if np.isfinite(box).all():
            values.append(
                same_picture(pictures[first.film][a], pictures[second.film][b], box, replay)
            )
    return float(np.median(values)) if values else 0.0


def _groups(occurrences: Sequence[Occurrence], same: dict[Pair, Replay]) -> dict[int, SameTakeAs]:
    """Of every group of showings, all but the best, with the best one and the ratio of speeds."""
    group = list(range(len(occurrences)))
    for i, k in same:
        old, new = group[k], group[i]
        group = [new if g == old else g for g in group]
    again: dict[int, SameTakeAs] = {}
    for number in set(group):
        members = [i for i, g in enumerate(group) if g == number]
        best = max(members, key=lambda i: occurrences[i].quality)
        for i in members:
            if i != best:
                again[i] = SameTakeAs(best, _speed(i, best, occurrences, same))
    return again


def _speed(i: int, best: int, occurrences: Sequence[Occurrence], same: dict[Pair, Replay]) -> float:
    """Speed of one showing, times another's."""
    if (best, i) in same:
        return 1 / same[best, i].rate
    if (i, best) in same:
        return same[i, best].rate
    return occurrences[i].rate / occurrences[best].rate
