"""The movement that is looked for: that of an example, or the one that is repeated most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from imocap_core.body.layouts import layout_names
from imocap_core.collect.cycles import cycle_around, cycles_of
from imocap_core.collect.dominant import dominant_template
from imocap_core.collect.features import RATE_HZ, at_rate, part_of, samples_of
from imocap_core.collect.film_tracks import FilmTracks
from imocap_core.collect.films import LongFilm
from imocap_core.collect.matching import Template, template_of
from imocap_core.collect.same_takes import shows_again
from imocap_core.collect.shots import Shot
from imocap_core.collect.tracks import shot_tracks
from imocap_core.conventions import mirror_indices
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.params import CollectParams, KeypointsParams, RepetitionParams

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


def repeated_movement(
    films: Sequence[LongFilm],
    people: FilmTracks,
    params: CollectParams,
    repetitions: RepetitionParams,
) -> SoughtMovement:
    """The movement that is repeated most in the films. WorkFailed where none is."""
    twins = mirror_indices(layout_names(films[0].people.layout))

    @cache
    def same_take(a: int, b: int) -> bool:
        return shows_again(people.tracks[a], people.tracks[b], twins)

    best = dominant_template(people.samples, people.pool(), same_take, params)
    if best is None:
        raise WorkFailed(
            "no movement is repeated in these films: give an example with --like VIDEO --from S "
            "--to S"
        )
    template, index, start = best
    track, samples = people.tracks[index], at_rate(people.samples[index], 1.0)
    last = min(start + len(template.background), len(samples.frame)) - 1
    first, stop = int(samples.frame[start]), int(samples.frame[last]) + 1
    whole = cycle_around(first, stop, cycles_of(track, repetitions))
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
    tracks = shot_tracks(0, film.people, [shot], params.min_confidence, params.max_gap_s)
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
