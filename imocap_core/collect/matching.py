"""Occurrences of a template movement in tracks: subsequence DTW at several playback rates.

A window matches a window of the template as far as it is nearer to it than what all the films show
is. Movements that differ from everything else in the films thus need not match as closely as
standing, which is near to any standing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.collect.features import (
    RATE_HZ,
    TrackSamples,
    mirrored,
    pose_change,
    squared_distances,
)
from imocap_core.collect.tracks import ShotTrack
from imocap_core.params import CollectParams
from imocap_core.sync.repetition.template_matching import subsequence_dtw

USUAL_M2 = 0.04  # squared distance of unrelated poses, about
LEAST_M2 = 0.008  # of the background, where films show little but the action
FEW = 8  # people, whose scores say little about others
LEAST_SPREAD = 0.03  # median deviation of scores
OVERLAP = 0.3  # of the shorter: two matches of a track overlap by at most so much
WORST = -0.3  # likeness of poses as unlike as can be: one bad stretch does not decide
UNSEEN = 2.0  # times the level: squared distance to a frame without the person


@dataclass(frozen=True)
class Template:
    """Windows of the movement that is looked for, its `samples`.

    background: median squared distance of all windows of the films to each, square metres. weight:
    of each, largest where it moves, in poses that are seldom in the films.
    """

    samples: TrackSamples
    background: Float[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return len(self.background) / RATE_HZ


@dataclass(frozen=True)
class Match:
    """A stretch of a track that repeats the template.

    track: index. first, stop: frames of the track. rate: its speed, times the template's. score:
    1 for the template itself, 0 for what is as far away as everything else. mirrored: the mirrored
    template matches; mirror_margin: by how much more of a score.
    """

    track: int
    first: int
    stop: int
    rate: float
    score: float
    mirrored: bool
    mirror_margin: float = 0.0


def template_of(samples: TrackSamples, pool: TrackSamples) -> Template:
    """A template, and how far all windows of the films, the pool, are from it."""
    squares = squared_distances(samples, pool)
    unknown = ~np.isfinite(squares).any(axis=1)
    squares[unknown] = LEAST_M2
    background = np.maximum(np.nanmedian(squares, axis=1), LEAST_M2)
    typical = np.sqrt(np.mean(pose_change(pool.windows) ** 2))
    moving = np.minimum(pose_change(samples.windows) / max(typical, 1e-6), 1.0)
    return Template(samples, background, np.where(unknown, 0.0, moving * background / USUAL_M2))


def similarity(
    template: Template, samples: TrackSamples, level: float, *, mirror: bool = False
) -> Float[np.ndarray, "n N"]:
    """1 for equal windows, 0 at `level` times the background's distance, at least WORST, all times
    the weight of the template's window."""
    squares = squared_distances(template.samples, mirrored(samples) if mirror else samples)
    scale = template.background[:, None]
    ratio = np.where(np.isfinite(squares), squares / (level * scale), UNSEEN)
    return np.clip(1.0 - ratio, WORST, 1.0) * template.weight[:, None]


def matches_in(
    index: int,
    track: ShotTrack,
    rates: Sequence[TrackSamples],
    template: Template,
    params: CollectParams,
) -> list[Match]:
    """The matches of a template in one track, the best first, without overlap, of any score."""
    every = [
        match
        for samples in rates
        for mirror in (False, True)
        for match in _candidates(index, track, samples, template, params, mirror)
    ]
    best: list[Match] = []
    for match in sorted(every, key=lambda m: -m.score):
        if all(overlap(match, other) <= OVERLAP for other in best):
            best.append(_by_side(match, every, params.mirror_margin))
    return best


def score_threshold(best: Sequence[float], params: CollectParams) -> float:
    """The score from which on a match is an occurrence, from everybody's best scores.

    Most people in long films do something else; their scores tell how like the template anything
    is. Of few people nothing can be told.
    """
    if len(best) < FEW:
        return 0.5 * (params.least_score + params.certain_score)
    median = float(np.median(best))
    spread = 1.4826 * max(float(np.median(np.abs(np.array(best) - median))), LEAST_SPREAD)
    clear = median + params.least_contrast * spread
    return min(max(clear, params.least_score), params.certain_score)


def _candidates(
    index: int,
    track: ShotTrack,
    samples: TrackSamples,
    template: Template,
    params: CollectParams,
    mirror: bool,
) -> list[Match]:
    """The best match that ends with each sample."""
    n = len(template.background)
    if 2 * len(samples.frame) < n:
        return []
    whole = float(template.weight.sum())
    total, begin = subsequence_dtw(similarity(template, samples, params.match_level, mirror=mirror))
    matches = []
    for end in np.flatnonzero(total[-1] > 0):
        first, last = samples.frame[begin[-1, end]], samples.frame[end]
        rate = (n - 1) / RATE_HZ * track.fps / max(last - first, 1.0)
        if params.slowest <= rate <= params.fastest:
            score = float(total[-1, end]) / whole
            matches.append(Match(index, int(first), int(last) + 1, rate, score, mirror))
    return matches


def _by_side(match: Match, every: Sequence[Match], margin: float) -> Match:
    """The match as it is or mirrored: mirrored only where it is better by a clear margin."""
    there = [m for m in every if overlap(m, match) > 0.5]
    plain = [m for m in there if not m.mirrored]
    best = max(plain, key=lambda m: m.score) if plain else None
    reflected = max((m.score for m in there if m.mirrored), default=0.0)
    gain = reflected - (best.score if best is not None else 0.0)
    if not match.mirrored or best is None or gain >= margin:
        return replace(match, mirror_margin=gain)
    return replace(best, mirror_margin=gain)


def overlap(a: Match, b: Match) -> float:
    """Frames that two matches of a track have in common, as a share of the shorter one's; at most 0
    where there are none."""
    shared = min(a.stop, b.stop) - max(a.first, b.first)
    return shared / max(1, min(a.stop - a.first, b.stop - b.first))
