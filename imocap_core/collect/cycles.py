"""Whole cycles of people who repeat a movement: neither half of one, nor one twice.

Subsequence matching finds the most alike stretch, which may be a part of the movement, or several
that overlap. Where a person repeats the movement within a shot, the clip itself says where a cycle
begins and ends (`sync/repetition`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from imocap_core.collect.matching import Match
from imocap_core.collect.tracks import ShotTrack
from imocap_core.params import RepetitionParams
from imocap_core.sync.repetition.segmentation import find_repetitions
from imocap_core.sync.repetition.template_matching import Span

WITHIN = 0.7  # of a stretch lies in the cycle that it is a part of


def cycles_of(track: ShotTrack, params: RepetitionParams) -> tuple[Span, ...]:
    """Frames of the track's cycles, from each one's first to one past its last; none where it shows
    fewer than two."""
    spans = find_repetitions(track.joints, track.fps, params).spans
    return spans if len(spans) > 1 else ()


def cycle_around(first: int, stop: int, cycles: Sequence[Span]) -> Span | None:
    """The cycle of which some frames are a part; None where they are not part of one."""
    shared = {c: min(stop, c[1]) - max(first, c[0]) for c in cycles}
    best = max(cycles, key=lambda c: shared[c], default=None)
    inside = best is not None and shared[best] >= WITHIN * (stop - first)
    return best if inside else None


def in_whole_cycles(matches: Sequence[Match], cycles: Sequence[Span], least: float) -> list[Match]:
    """The matches of one track that are occurrences, the best first.

    A match that is part of a cycle is the whole cycle, each once. Who repeats the movement does so
    in every cycle that matches at all, if one match is good enough.

    Args:
        matches: the best first, of any score. least: score from which on one is an occurrence.
    """
    if not matches or matches[0].score < least:
        return []
    cycles_taken: list[Match] = []
    taken: set[Span] = set()
    for match in matches:
        cycle = cycle_around(match.first, match.stop, cycles)
        if cycle is None:
            if match.score >= least:
                cycles_taken.append(match)
        elif cycle not in taken:
            taken.add(cycle)
            rate = match.rate * (match.stop - match.first) / (cycle[1] - cycle[0])
            cycles_taken.append(replace(match, first=cycle[0], stop=cycle[1], rate=rate))
    return [
        m
        for k, m in enumerate(cycles_taken)
        if not any(_same(m, other) for other in cycles_taken[:k])
    ]


def _same(a: Match, b: Match) -> bool:
    """Whether the middle of either lies in the other."""
    middle_a, middle_b = (a.first + a.stop) / 2, (b.first + b.stop) / 2
    return b.first <= middle_a < b.stop or a.first <= middle_b < a.stop
