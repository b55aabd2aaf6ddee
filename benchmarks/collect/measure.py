"""Every action collected from the compilations, scored, and the motion of one of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree

from benchmarks.actions.action_folder import action_key
from benchmarks.collect.edit import CutPiece, film_places, write_film
from benchmarks.collect.films import Compilation, reported_films
from benchmarks.collect.motion import add_truth, clean_action
from benchmarks.collect.truth import (
    Tally,
    action_of,
    boundary_tally,
    mirror_tally,
    occurrence_tally,
    replay_tally,
    shown_by,
    true_boundaries,
)
from benchmarks.scoring.score import score_action
from benchmarks.scoring.score_file import ActionScore
from imocap_core.collect.listing import CollectedList
from imocap_core.io.video import probe
from imocap_core.library.new_action import collect
from imocap_core.pipeline.runner import Display
from imocap_core.pipeline.source import closure
from imocap_core.workspace import Workspace

RUN = "serve"  # the action whose motion is compared
EDGE_S = 0.1  # of an example, at its ends


@dataclass(frozen=True)
class CollectedScore:
    """One action: shots that show it, replays and mirrored shots among its occurrences."""

    action: str
    example: bool
    occurrences: Tally
    replays: Tally
    mirrored: Tally
    videos: int


@dataclass(frozen=True)
class CollectScores:
    """All numbers. shots: of the films; boundaries: by kind, then all of them."""

    shots: int
    boundaries: dict[str, Tally]
    actions: list[CollectedScore]
    motion: dict[str, ActionScore]


def measure(workspace: Workspace, folder: Path, display: Display, *, run: bool) -> CollectScores:
    """Make the films, collect every action from them, and run one of them.

    Films, detections and stages are stored; an interrupted measurement goes on where it stopped.
    """
    display.started("film", ["the compilations are made of rendered takes"])
    compilation = reported_films(workspace.root, folder)
    files, places = _written(compilation, folder, display)
    rmtree(folder / "actions", ignore_errors=True)
    lists: dict[str, CollectedList] = {}
    scores = []
    for action, example in compilation.examples.items():
        length = probe(example).frame_count / probe(example).fps
        span = (example, EDGE_S, length - EDGE_S)
        done = collect(action, files, example=span, root=folder, progress=display)
        lists[action] = done.listing
        scores.append(_score(action, done.listing, places, example=True))
    dominant = collect("dominant", files, root=folder, progress=display).listing
    scores.append(_score(_most_frequent(dominant, places), dominant, places, example=False))
    shots = {k: film.shots for k, film in enumerate(dominant.films)}
    boundaries = {
        kind: _sum(
            boundary_tally(shots[k], [b for b in true_boundaries(p) if kind in ("all", b[2])])
            for k, p in places.items()
        )
        for kind in ("cut", "dissolve", "wipe", "fade", "black", "all")
    }
    count = sum(p.piece.file is not None for film in places.values() for p in film)
    motion = _motion(folder, lists[RUN], places, display) if run else {}
    return CollectScores(count, boundaries, scores, motion)


def _written(
    compilation: Compilation, folder: Path, display: Display
) -> tuple[list[Path], dict[int, list[CutPiece]]]:
    """The films' files, and where every piece is in them.

    A film that is there stays: encoded again it may differ in a bit, and would be detected again.
    """
    code = [closure(Path(__file__).with_name(name)) for name in ("edit.py", "films.py")]
    key = action_key(code, [])[:12]
    files, places = [], {}
    for number, (name, pieces) in enumerate(compilation.films.items()):
        display.progress(number / len(compilation.films), f"cutting {name}")
        file = folder / "films" / key / f"{name}.mp4"
        file.parent.mkdir(parents=True, exist_ok=True)
        places[number] = film_places(pieces) if file.is_file() else write_film(file, pieces)
        files.append(file)
    return files, places


def _score(
    action: str, listing: CollectedList, places: Mapping[int, Sequence[CutPiece]], *, example: bool
) -> CollectedScore:
    return CollectedScore(
        action,
        example,
        occurrence_tally(listing, places, action),
        replay_tally(listing, places),
        mirror_tally(listing, places, action),
        len(listing.chosen),
    )


def _most_frequent(listing: CollectedList, places: Mapping[int, Sequence[CutPiece]]) -> str:
    """The action that most occurrences show."""
    shown = [action_of(shown_by(o, places[o.film])) for o in listing.occurrences]
    named = [action for action in shown if action is not None]
    return max(set(named), key=named.count) if named else "none"


def _sum(tallies: Iterable[Tally]) -> Tally:
    rows = list(tallies)
    return Tally(*(sum(getattr(t, f) for t in rows) for f in ("there", "found_right", "wrong")))


def _motion(
    folder: Path, listing: CollectedList, places: Mapping[int, Sequence[CutPiece]], display: Display
) -> dict[str, ActionScore]:
    """Scores of the collected action and of the same takes as clean clips."""
    clean = f"{RUN}_clean"
    add_truth(folder / "actions" / RUN, listing, places)
    clean_action(folder / "actions" / clean, listing, places)
    scores = {}
    for name in (RUN, clean):
        job = Workspace(folder).ready_job(name, [], display)
        file = folder / "scores" / f"{name}.json"
        scores[name] = score_action(job, display, file, folder / "costs", with_oracle=False)
    return scores


def write_numbers(scores: CollectScores, file: Path) -> None:
    """The tallies as JSON, for programs."""
    rows = {
        "boundaries": {kind: vars(tally) for kind, tally in scores.boundaries.items()},
        "actions": [
            {name: vars(v) if isinstance(v, Tally) else v for name, v in vars(a).items()}
            for a in scores.actions
        ],
    }
    file.write_text(json.dumps(rows, indent=1))
