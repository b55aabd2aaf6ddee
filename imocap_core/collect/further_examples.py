"""The clearest matches of an example serve as further examples.

One example shows the movement from one side, by one performer; its occurrences in the films are
nearer to each other. So the clearest matches become templates, too, and a match has the mean of its
scores under all templates. One wrong match among them weighs little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imocap_core.collect.features import RATES, TrackSamples, at_rate, mirrored, part_of
from imocap_core.collect.film_tracks import FilmTracks
from imocap_core.collect.matching import (
    Match,
    Template,
    matches_in,
    overlap,
    score_threshold,
    template_of,
)
from imocap_core.params import CollectParams

LEAST_SCORE = 0.5  # of a further example
MOST = 6
SAME = 0.5  # of the shorter stretch that two matches of one occurrence share


def matches_of_all(
    people: FilmTracks, template: Template, params: CollectParams
) -> list[list[Match]]:
    """Of each track the matches of a template, the best first."""
    pairs = zip(people.tracks, people.samples, strict=True)
    return [matches_in(i, track, rates, template, params) for i, (track, rates) in enumerate(pairs)]


def by_further_examples(
    people: FilmTracks, matches: Sequence[Sequence[Match]], params: CollectParams
) -> list[list[Match]]:
    """The matches with the mean of their scores under the template and under the clearest ones, the
    best first."""
    examples, pool = clearest(matches, params), people.pool()
    templates = [template_at(people, match, pool) for match in examples]
    rematched = [matches_of_all(people, template, params) for template in templates]

    def score(match: Match) -> float:
        others = [
            max((m.score for m in again[match.track] if overlap(m, match) > SAME), default=0.0)
            for example, again in zip(examples, rematched, strict=True)
            if example != match
        ]
        return float(np.mean([match.score, *others]))

    scored = [[replace(match, score=score(match)) for match in of_track] for of_track in matches]
    return [sorted(of_track, key=lambda m: -m.score) for of_track in scored]


def clearest(matches: Sequence[Sequence[Match]], params: CollectParams) -> list[Match]:
    """At most one match a track, those that are most alike."""
    best = sorted((of_track[0] for of_track in matches if of_track), key=lambda m: -m.score)
    least = max(LEAST_SCORE, threshold(matches, params))
    return [match for match in best[:MOST] if match.score >= least]


def threshold(matches: Sequence[Sequence[Match]], params: CollectParams) -> float:
    """The score from which on a match is an occurrence."""
    best = [max((m.score for m in of_track), default=0.0) for of_track in matches]
    return score_threshold(best, params)


def template_at(people: FilmTracks, match: Match, pool: TrackSamples) -> Template:
    """The stretch that matches, at the playback rate nearest to its own, as the template shows it:
    a mirrored one in a mirror."""
    rate = min(RATES, key=lambda r: abs(np.log(r / match.rate)))
    samples = at_rate(people.samples[match.track], rate)
    stretch = part_of(samples, (samples.frame >= match.first) & (samples.frame < match.stop))
    return template_of(mirrored(stretch) if match.mirrored else stretch, pool)
