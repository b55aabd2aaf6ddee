"""From films to the list of what is in them, and the action of the chosen occurrences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from imocap_core.body.layouts import layout_names
from imocap_core.collect import listing
from imocap_core.collect.films import LongFilm, look_through
from imocap_core.collect.matching import FilmTracks, Match, film_tracks
from imocap_core.collect.movement import (
    Example,
    SoughtMovement,
    by_further_examples,
    cycles_of,
    example_movement,
    in_whole_cycles,
    matches_of_all,
    repeated_movement,
    threshold,
)
from imocap_core.collect.same_takes import showings
from imocap_core.conventions import mirror_indices
from imocap_core.detect.detectors import detector_of
from imocap_core.errors import WorkFailed
from imocap_core.params import Params
from imocap_core.pipeline.action import declared_path
from imocap_core.pipeline.runner import Display
from imocap_core.sync_sources import VideoSource, labels
from imocap_core.workspace import Workspace

STEP = "collect"
_MARGIN_S = 0.15  # of a shot, taken before and after an occurrence


def collect_films(
    workspace: Workspace,
    name: str,
    files: Sequence[Path],
    example: Example | None,
    params: Params,
    folder: Path,
    display: Display,
) -> tuple[listing.CollectedList, dict[str, bool]]:
    """Everything in some films, and of each chosen occurrence whether its shot shows nobody else.

    Args:
        folder: the action's, from which paths are written.
    """
    films = _looked_through(workspace, files, params, display)
    people = film_tracks(films, params.keypoints)
    movement = _movement(workspace, example, films, people, params, display)
    display.progress(0.9, "looking for the action")
    by_example = matches_of_all(people, movement.template)
    display.progress(0.95, "looking for more like what was found")
    every = by_further_examples(people, by_example, params.collect)
    least = threshold(every, params.collect)
    matches = [
        match
        for of_track, track in zip(every, people.tracks, strict=True)
        if of_track and of_track[0].score >= least
        for match in in_whole_cycles(of_track, cycles_of(track), least)
    ]
    if not matches:
        raise WorkFailed(
            f"nothing in {', '.join(f.name for f in files)} is like "
            f"{'the example' if movement.given else 'anything else in it'}: give another example "
            "with --like VIDEO --from S --to S, or a smaller --set collect.least_contrast"
        )
    occurrences = [_occurrence(m, films, people) for m in matches]
    matches, occurrences = _each_once(matches, occurrences)
    same_takes = showings(
        occurrences,
        [people.tracks[m.track] for m in matches],
        [film.path for film in films],
        mirror_indices(layout_names(films[0].layout)),
    )
    names = listing.occurrence_names(
        occurrences, labels([VideoSource(file, None) for file in files])
    )
    fps = [films[o.film].info.fps for o in occurrences]
    decisions = listing.decide(occurrences, same_takes, names, fps, params.collect)
    rows = [
        listing.listed_occurrence(n, o, d, names, f)
        for n, o, d, f in zip(names, occurrences, decisions, fps, strict=True)
    ]
    collected = listing.CollectedList(
        name=name,
        template=listing.ListedTemplate(
            video=declared_path(movement.video, folder),
            frames=movement.frames,
            seconds=listing.seconds(movement.frames, movement.fps),
            given=movement.given,
        ),
        films=[_listed_film(k, film, people, every, rows, folder) for k, film in enumerate(films)],
        occurrences=rows,
    )
    alone = {n: o.alone for n, o, d in zip(names, occurrences, decisions, strict=True) if d.chosen}
    return collected, alone


def _each_once(
    matches: Sequence[Match], occurrences: Sequence[listing.Occurrence]
) -> tuple[list[Match], list[listing.Occurrence]]:
    """Without those that show the same person at the same time, followed twice: the best stays."""
    order = sorted(range(len(matches)), key=lambda i: -occurrences[i].quality)
    chosen_windows: list[int] = []
    for i in order:
        if not any(listing.shows_same(occurrences[i], occurrences[k]) for k in chosen_windows):
            chosen_windows.append(i)
    return [matches[i] for i in sorted(chosen_windows)], [
        occurrences[i] for i in sorted(chosen_windows)
    ]


def _looked_through(
    workspace: Workspace, files: Sequence[Path], params: Params, display: Display
) -> list[LongFilm]:
    detector = detector_of(params.detect, workspace.root)
    films = []
    for file in files:
        display.started(STEP, [f"{file.name} may show the action"])
        films.append(look_through(file, detector, workspace.store, display))
    return films


def _movement(
    workspace: Workspace,
    example: Example | None,
    films: Sequence[LongFilm],
    people: FilmTracks,
    params: Params,
    display: Display,
) -> SoughtMovement:
    if example is None:
        display.progress(0.5, "looking for what is repeated")
        return repeated_movement(films, people)
    same = [f for f in films if f.path.resolve() == example.video.resolve()]
    film = same[0] if same else _looked_through(workspace, [example.video], params, display)[0]
    return example_movement(example, film, people, params.keypoints)


def _occurrence(match: Match, films: Sequence[LongFilm], people: FilmTracks) -> listing.Occurrence:
    track = people.tracks[match.track]
    alone = len(people.of_shot(track.film, track.shot)) == 1
    shot = films[track.film].shots[track.shot]
    return listing.occurrence_of(match, track, shot, _MARGIN_S, alone=alone)


def _listed_film(
    number: int,
    film: LongFilm,
    people: FilmTracks,
    matches: Sequence[Sequence[Match]],
    rows: Sequence[listing.ListedOccurrence],
    folder: Path,
) -> listing.ListedFilm:
    shots = []
    for k, shot in enumerate(film.shots):
        tracks = people.of_shot(number, k)
        best = max((m.score for i in tracks for m in matches[i]), default=None)
        of_shot = [row for row in rows if (row.film, row.shot) == (number, k + 1)]
        shots.append(listing.listed_shot(k, shot, len(tracks), of_shot, best, film.info.fps))
    return listing.ListedFilm(
        video=declared_path(film.path, folder),
        fps=film.info.fps,
        size=film.info.size,
        frame_count=film.info.frame_count,
        shots=shots,
    )
