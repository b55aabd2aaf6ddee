"""The movement that is looked for: that of an example, or the one that is repeated most.

Of people who repeat a movement, whole cycles: subsequence matching finds the most alike stretch,
which may be a part or several that overlap, so the clip itself says where a cycle begins and ends
(`sync/repetition`). The dominant movement of films is the stretch that explains most of all others,
as there, but over many tracks.

One example shows the movement from one side, by one performer. So its clearest matches become
templates too, and a match has the mean of its scores under all: a wrong one weighs little.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.collect.films import LongFilm, ShotTrack, shot_tracks
from imocap_core.collect.matching import (
    RATE_HZ,
    RATES,
    FilmTracks,
    Match,
    Template,
    TrackSamples,
    at_rate,
    matches_in,
    mirrored,
    overlap,
    part_of,
    samples_of,
    score_threshold,
    similarity,
    template_of,
)
from imocap_core.collect.same_takes import shows_again
from imocap_core.collect.shots import Shot
from imocap_core.conventions import mirror_indices
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.params import CollectParams, KeypointsParams
from imocap_core.sync.repetition import Span, best_totals, find_repetitions, subsequence_dtw

WITHIN = 0.7  # of a stretch lies in the cycle that it is a part of


def cycles_of(track: ShotTrack) -> tuple[Span, ...]:
    """Frames of the track's cycles, from each one's first to one past its last; none where it shows
    fewer than two."""
    spans = find_repetitions(track.joints, track.fps).spans
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

    def holds_middle(a: Match, b: Match) -> bool:
        return a.first <= (b.first + b.stop) / 2 < a.stop

    return [
        m
        for k, m in enumerate(cycles_taken)
        if not any(holds_middle(m, n) or holds_middle(n, m) for n in cycles_taken[:k])
    ]


MAX_STARTS = 160  # stretches that are tried
COUNTED = 0.5  # of the least likeness is subtracted: what is just like enough counts half
TRIED_RATES = (0.25, 1.0)
_SHORTEST_S, _LONGEST_S = 1.0, 3.0
_RECURRING_SCORE = 0.6  # from which on a stretch counts as a repetition


def dominant_template(
    tracks: Sequence[Sequence[TrackSamples]],
    pool: TrackSamples,
    same_take: Callable[[int, int], bool],
) -> tuple[Template, int, int] | None:
    """The template, the track that it is of, and the sample (at rate 1) that it begins with; None
    where nothing recurs.

    Args:
        tracks: of each track its samples at several rates.
        same_take: whether two tracks show one take, which explains nothing.
    """
    shortest, longest = (round(s * RATE_HZ) for s in (_SHORTEST_S, _LONGEST_S))
    best: tuple[float, int, int, int] | None = None
    for track, start in _starts(tracks, shortest):
        stretch = part_of(at_rate(tracks[track], 1.0), slice(start, start + longest))
        template = template_of(stretch, pool)
        explained = np.zeros(len(stretch.frame))
        for other, rates in enumerate(tracks):
            gain = _explained(template, rates)
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


def _explained(template: Template, rates: Sequence[TrackSamples]) -> Float[np.ndarray, " n"]:
    """How much of a track every beginning of a template explains: the weighted samples of its
    occurrences, times by how much they exceed the least likeness."""
    weight = np.cumsum(template.weight)
    explained = np.zeros(len(weight))
    for samples in rates:
        if samples.rate in TRIED_RATES:
            row = similarity(template, samples)
            total, begin = subsequence_dtw(row)
            least = _RECURRING_SCORE * weight[:, None]
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


LEAST_SCORE = 0.5  # of a further example
MOST = 6
SAME = 0.5  # of the shorter stretch that two matches of one occurrence share


def matches_of_all(people: FilmTracks, template: Template) -> list[list[Match]]:
    """Of each track the matches of a template, the best first."""
    pairs = zip(people.tracks, people.samples, strict=True)
    return [matches_in(i, track, rates, template) for i, (track, rates) in enumerate(pairs)]


def by_further_examples(
    people: FilmTracks, matches: Sequence[Sequence[Match]], params: CollectParams
) -> list[list[Match]]:
    """The matches with the mean of their scores under the template and under the clearest ones, the
    best first."""
    examples, pool = clearest(matches, params), people.pool()
    templates = [template_at(people, match, pool) for match in examples]
    rematched = [matches_of_all(people, template) for template in templates]

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


LEAST_S = 0.3  # of an example


@dataclass(frozen=True)
class Example:
    """A part of a film that shows the action, from and to in seconds."""

    video: Path
    from_s: float
    to_s: float

    def __str__(self) -> str:
        return f"--from {self.from_s:g} --to {self.to_s:g}"


@dataclass(frozen=True)
class SoughtMovement:
    """The template, and the film and frames that it is of."""

    template: Template
    video: Path
    frames: tuple[int, int]
    fps: float
    given: bool


def repeated_movement(films: Sequence[LongFilm], people: FilmTracks) -> SoughtMovement:
    """The movement that is repeated most in the films. WorkFailed where none is."""
    twins = mirror_indices(layout_names(films[0].layout))

    @cache
    def same_take(a: int, b: int) -> bool:
        return shows_again(people.tracks[a], people.tracks[b], twins)

    best = dominant_template(people.samples, people.pool(), same_take)
    if best is None:
        raise WorkFailed(
            "no movement is repeated in these films: give an example with --like VIDEO --from S "
            "--to S"
        )
    template, index, start = best
    track, samples = people.tracks[index], at_rate(people.samples[index], 1.0)
    last = min(start + len(template.background), len(samples.frame)) - 1
    first, stop = int(samples.frame[start]), int(samples.frame[last]) + 1
    whole = cycle_around(first, stop, cycles_of(track))
    if whole is not None:
        first, stop = whole
        inside = (samples.frame >= first) & (samples.frame < stop)
        template = template_of(part_of(samples, inside), people.pool())
    frames = (track.first + first, track.first + stop)
    return SoughtMovement(template, films[track.film].path, frames, track.fps, given=False)


def example_movement(
    example: Example, film: LongFilm, people: FilmTracks, params: KeypointsParams
) -> SoughtMovement:
    """The movement of the most prominent person in the example, which is of `film`."""
    first, stop = _frames(example, film)
    shot = _shot(example, film, first, stop)
    tracks = shot_tracks(0, film, [shot], params)
    track = next((t for t in tracks if t.first <= first and stop <= t.stop), None)
    if track is None:
        raise WorkFailed(
            f"nobody is detected in {example.video} from {example.from_s:g} to {example.to_s:g} s "
            "all the time: choose another example"
        )
    samples = samples_of(track, 1.0)
    inside = (samples.frame >= first - track.first) & (samples.frame < stop - track.first)
    if inside.sum() < LEAST_S * RATE_HZ:
        raise WrongUse(f"{example}: expected an example of at least {LEAST_S:g} s")
    template = template_of(part_of(samples, inside), people.pool())
    return SoughtMovement(template, example.video, (first, stop), film.info.fps, given=True)


def _frames(example: Example, film: LongFilm) -> tuple[int, int]:
    """First and one past the last frame of the example."""
    info = film.info
    if 0 <= example.from_s < example.to_s < float("inf"):
        first, stop = round(example.from_s * info.fps), round(example.to_s * info.fps)
        if first < stop <= info.frame_count:
            return first, stop
    raise WrongUse(
        f"{example}: expected times in {example.video}, which is "
        f"{info.frame_count / info.fps:.2f} s long"
    )


def _shot(example: Example, film: LongFilm, first: int, stop: int) -> Shot:
    """The shot that shows all of the example."""
    for shot in film.shots:
        if shot.first <= first and stop <= shot.stop:
            return shot
    edges = ", ".join(f"{s.first / film.info.fps:.2f}" for s in film.shots)
    raise WrongUse(
        f"{example}: expected a part of one shot of {example.video}; shots begin at {edges} s"
    )
