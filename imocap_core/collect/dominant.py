"""The dominant repeated movement of films: the stretch that explains most of all other stretches.

As in `imocap_core.sync.repetition.segmentation`, but over many tracks: a stretch of one is a
template, and what counts is how much its occurrences elsewhere explain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.collect.features import RATE_HZ, TrackSamples, at_rate, part_of
from imocap_core.collect.matching import Template, similarity, template_of
from imocap_core.params import CollectParams
from imocap_core.sync.repetition.template_matching import (
    best_totals,
    subsequence_dtw,
)

MAX_STARTS = 160  # stretches that are tried
COUNTED = 0.5  # of the least likeness is subtracted: what is just like enough counts half
TRIED_RATES = (0.25, 1.0)


def dominant_template(
    tracks: Sequence[Sequence[TrackSamples]],
    pool: TrackSamples,
    same_take: Callable[[int, int], bool],
    params: CollectParams,
) -> tuple[Template, int, int] | None:
    """The template, the track that it is of, and the sample (at rate 1) that it begins with; None
    where nothing recurs.

    Args:
        tracks: of each track its samples at several rates.
        same_take: whether two tracks show one take, which explains nothing.
    """
    shortest, longest = (round(s * RATE_HZ) for s in (params.shortest_s, params.longest_s))
    best: tuple[float, int, int, int] | None = None
    for track, start in _starts(tracks, shortest):
        stretch = part_of(at_rate(tracks[track], 1.0), slice(start, start + longest))
        template = template_of(stretch, pool)
        explained = np.zeros(len(stretch.frame))
        for other, rates in enumerate(tracks):
            gain = _explained(template, rates, params)
            if gain.any() and other != track and not same_take(track, other):
                explained += gain
        explained[: shortest - 1] = 0.0
        length = int(np.argmax(explained)) + 1
        if best is None or explained[length - 1] > best[0]:
            best = (float(explained[length - 1]), track, start, length)
    if best is None or best[0] <= 0:
        return None
    _, track, start, length = best
    stretch = part_of(at_rate(tracks[track], 1.0), slice(start, start + length))
    return template_of(stretch, pool), track, start


def _explained(
    template: Template, rates: Sequence[TrackSamples], params: CollectParams
) -> Float[np.ndarray, " n"]:
    """How much of a track every beginning of a template explains: the weighted samples of its
    occurrences, times by how much they exceed the least likeness."""
    weight = np.cumsum(template.weight)
    explained = np.zeros(len(weight))
    for samples in rates:
        if samples.rate in TRIED_RATES:
            row = similarity(template, samples, params.match_level)
            total, begin = subsequence_dtw(row)
            least = params.recurring_score * weight[:, None]
            value = np.where(total >= least, total - COUNTED * least, -np.inf)
            explained = np.maximum(explained, best_totals(value, begin)[:, -1])
    return explained


def _starts(tracks: Sequence[Sequence[TrackSamples]], shortest: int) -> list[tuple[int, int]]:
    """Tracks and samples at which templates begin, evenly over all of them."""
    possible = [
        (number, start)
        for number, rates in enumerate(tracks)
        for start in range(0, max(0, len(at_rate(rates, 1.0).frame) - shortest))
    ]
    step = max(3, -(-len(possible) // MAX_STARTS))
    return possible[::step]
