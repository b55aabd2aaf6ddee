"""From films to the list of what is in them, and the action of the chosen occurrences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from imocap_core.body.layouts import layout_names
from imocap_core.collect.choice import decide
from imocap_core.collect.dominant import dominant_template
from imocap_core.collect.features import (
    RATE_HZ,
    RATES,
    TrackSamples,
    part_of,
    pooled,
    samples_of,
)
from imocap_core.collect.films import LongFilm, look_through
from imocap_core.collect.listing import (
    CollectedList,
    ListedFilm,
    ListedOccurrence,
    ListedTemplate,
    listed_occurrence,
    listed_shot,
    occurrence_names,
    seconds,
)
from imocap_core.collect.matching import (
    Match,
    Template,
    matches_in,
    score_threshold,
    template_of,
)
from imocap_core.collect.occurrences import Occurrence, occurrence_of
from imocap_core.collect.same_takes import showings, shows_again
from imocap_core.collect.tracks import ShotTrack, shot_tracks
from imocap_core.collect.writing import relative
from imocap_core.conventions import mirror_indices
from imocap_core.detect.detectors import detector_of
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.params import CollectParams, Params
from imocap_core.pipeline.runner import Display
from imocap_core.standalone_sync.sources import VideoSource, labels
from imocap_core.workspace import Workspace

STEP = "collect"
MAX_POOL = 4000  # windows that tell how far anything is from the template


@dataclass(frozen=True)
class Example:
    """A part of a film that shows the action, from and to in seconds."""

    video: Path
    from_s: float
    to_s: float


@dataclass(frozen=True)
class SoughtMovement:
    """The template, and the film and frames that it is of."""

    template: Template
    video: Path
    frames: tuple[int, int]
    fps: float
    given: bool


@dataclass(frozen=True)
class Moving:
    """Everybody who moves in the films: tracks, and of each its samples at all rates."""

    tracks: list[ShotTrack]
    samples: list[list[TrackSamples]]

    @property
    def pool(self) -> TrackSamples:
        """Windows of everybody at the films' speed, evenly thinned out."""
        every = pooled([_at_speed(rates) for rates in self.samples])
        return part_of(every, slice(None, None, -(-len(every.frame) // MAX_POOL)))


def collect_films(
    workspace: Workspace,
    name: str,
    files: Sequence[Path],
    example: Example | None,
    params: Params,
    folder: Path,
    display: Display,
) -> tuple[CollectedList, dict[str, bool]]:
    """Everything in some films, and of each chosen occurrence whether its shot shows nobody else.

    Args:
        folder: the action's, from which paths are written.
    """
    films = _looked_through(workspace, files, params, display)
    moving = _moving(films, params)
    movement = _movement(workspace, example, films, moving, params, display)
    display.progress(0.9, "looking for the action")
    collect = params.collect
    lenient = [
        matches_in(i, track, rates, movement.template, collect)
        for i, (track, rates) in enumerate(zip(moving.tracks, moving.samples, strict=True))
    ]
    best = [max((m.score for m in of_track), default=0.0) for of_track in lenient]
    least = score_threshold(best, collect)
    matches = [m for of_track in lenient for m in of_track if m.score >= least]
    if not matches:
        raise WorkFailed(
            f"nothing in {', '.join(f.name for f in files)} is like "
            f"{'the example' if movement.given else 'anything else in it'}: give another example "
            "with --like VIDEO --from S --to S, or a smaller --set collect.least_contrast"
        )
    occurrences = [_occurrence(m, films, moving, collect) for m in matches]
    layout = films[0].people.layout
    again = showings(
        occurrences,
        [moving.tracks[m.track] for m in matches],
        [film.path for film in films],
        mirror_indices(layout_names(layout)),
    )
    names = occurrence_names(occurrences, _labels(files))
    fps = [films[o.film].info.fps for o in occurrences]
    decisions = decide(occurrences, again, names, fps, collect)
    rows = [
        listed_occurrence(n, o, d, names, f)
        for n, o, d, f in zip(names, occurrences, decisions, fps, strict=True)
    ]
    collected = CollectedList(
        name=name,
        template=ListedTemplate(
            video=relative(movement.video, folder),
            frames=movement.frames,
            seconds=seconds(movement.frames, movement.fps),
            given=movement.given,
        ),
        films=[_listed_film(k, films, moving, lenient, rows, folder) for k in range(len(films))],
        occurrences=rows,
    )
    alone = {n: o.alone for n, o, d in zip(names, occurrences, decisions, strict=True) if d.chosen}
    return collected, alone


def _looked_through(
    workspace: Workspace, files: Sequence[Path], params: Params, display: Display
) -> list[LongFilm]:
    detector = detector_of(params.detect, workspace.root)
    films = []
    for file in files:
        display.started(STEP, [f"{file.name} may show the action"])
        films.append(look_through(file, detector, workspace.store, display))
    return films


def _moving(films: Sequence[LongFilm], params: Params) -> Moving:
    keypoints = params.keypoints
    tracks = [
        track
        for number, film in enumerate(films)
        for track in shot_tracks(
            number, film.people, film.shots, keypoints.min_confidence, keypoints.max_gap_s
        )
    ]
    if not tracks:
        raise WorkFailed(
            "nobody moves in any shot: expected films in which people are large enough to be "
            "detected (docs/collect.md)"
        )
    return Moving(tracks, [[samples_of(track, rate) for rate in RATES] for track in tracks])


def _movement(
    workspace: Workspace,
    example: Example | None,
    films: Sequence[LongFilm],
    moving: Moving,
    params: Params,
    display: Display,
) -> SoughtMovement:
    if example is not None:
        return _example(workspace, example, films, moving, params, display)
    display.progress(0.5, "looking for what is repeated")
    twins = mirror_indices(layout_names(films[0].people.layout))

    @cache
    def same_take(a: int, b: int) -> bool:
        return shows_again(moving.tracks[a], moving.tracks[b], twins)

    best = dominant_template(moving.samples, moving.pool, same_take, params.collect)
    if best is None:
        raise WorkFailed(
            "no movement is repeated in these films: give an example with --like VIDEO --from S "
            "--to S"
        )
    template, index, start = best
    track = moving.tracks[index]
    frame = _at_speed(moving.samples[index]).frame
    last = min(start + len(template.background), len(frame)) - 1
    frames = (track.first + int(frame[start]), track.first + int(frame[last]) + 1)
    return SoughtMovement(template, films[track.film].path, frames, track.fps, given=False)


def _example(
    workspace: Workspace,
    example: Example,
    films: Sequence[LongFilm],
    moving: Moving,
    params: Params,
    display: Display,
) -> SoughtMovement:
    """The movement of the most prominent person in the example."""
    same = [f for f in films if f.path.resolve() == example.video.resolve()]
    film = same[0] if same else _looked_through(workspace, [example.video], params, display)[0]
    first, stop = (round(t * film.info.fps) for t in (example.from_s, example.to_s))
    length = len(film.people.people)
    if not 0 <= first < stop <= length:
        raise WrongUse(
            f"--from {example.from_s:g} --to {example.to_s:g}: expected times in {example.video}, "
            f"which is {length / film.info.fps:.2f} s long"
        )
    shot = [s for s in film.shots if s.first <= first and stop <= s.stop]
    if not shot:
        edges = ", ".join(f"{s.first / film.info.fps:.2f}" for s in film.shots)
        raise WrongUse(
            f"--from {example.from_s:g} --to {example.to_s:g}: expected a part of one shot of "
            f"{example.video}; shots begin at {edges} s"
        )
    keypoints = params.keypoints
    tracks = shot_tracks(0, film.people, shot, keypoints.min_confidence, keypoints.max_gap_s)
    there = [t for t in tracks if t.first <= first and stop <= t.stop]
    if not there:
        raise WorkFailed(
            f"nobody is detected in {example.video} from {example.from_s:g} to {example.to_s:g} s "
            "all the time: choose another example"
        )
    samples = samples_of(there[0], 1.0)
    inside = (samples.frame >= first - there[0].first) & (samples.frame < stop - there[0].first)
    if inside.sum() < 0.3 * RATE_HZ:
        raise WrongUse(f"the example is {stop - first} frames long: expected at least 0.3 s")
    template = template_of(part_of(samples, inside), moving.pool)
    return SoughtMovement(template, example.video, (first, stop), film.info.fps, given=True)


def _occurrence(
    match: Match, films: Sequence[LongFilm], moving: Moving, params: CollectParams
) -> Occurrence:
    track = moving.tracks[match.track]
    beside = [t for t in moving.tracks if (t.film, t.shot) == (track.film, track.shot)]
    shot = films[track.film].shots[track.shot]
    return occurrence_of(match, track, shot, params.margin_s, alone=len(beside) == 1)


def _listed_film(
    number: int,
    films: Sequence[LongFilm],
    moving: Moving,
    matches: Sequence[Sequence[Match]],
    rows: Sequence[ListedOccurrence],
    folder: Path,
) -> ListedFilm:
    film = films[number]
    shots = []
    for k, shot in enumerate(film.shots):
        there = [i for i, t in enumerate(moving.tracks) if (t.film, t.shot) == (number, k)]
        scores = [m.score for i in there for m in matches[i]]
        mine = [row for row in rows if (row.film, row.shot) == (number, k + 1)]
        best = max(scores, default=None)
        shots.append(listed_shot(k, shot, len(there), mine, best, film.info.fps))
    return ListedFilm(
        video=relative(film.path, folder),
        fps=film.info.fps,
        size=film.info.size,
        frame_count=len(film.people.people),
        shots=shots,
    )


def _at_speed(rates: Sequence[TrackSamples]) -> TrackSamples:
    return next(samples for samples in rates if samples.rate == 1.0)


def _labels(files: Sequence[Path]) -> list[str]:
    return labels([VideoSource(file, None) for file in files])
