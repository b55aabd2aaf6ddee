"""`imocap benchmark collect`: compilation films made in code, and what is collected from them.

Reading order:
    takes      performances rendered by a static camera, kept as small films
    edit       takes cut into a film: transitions, replays, captions, mirrored and still shots
    films      the films that are measured
    truth      shots and occurrences of a film, and how a list of collected ones compares
    motion     the truth of a collected action, and the same takes as clean clips
    measure    every film collected
    report     the tables
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np
import yaml
from rich.table import Table

from benchmarks.actions.action_folder import action_key
from benchmarks.collect_edit import (
    SIZE,
    Compilation,
    CutPiece,
    Tally,
    action_of,
    boundary_tally,
    film_places,
    mirror_tally,
    occurrence_tally,
    replay_tally,
    reported_films,
    shown_by,
    true_boundaries,
    write_film,
)
from benchmarks.collect_takes import SIZE as TAKE_SIZE
from benchmarks.names import BenchmarkOptions
from benchmarks.scoring import ActionScore, score_action
from benchmarks.tables import CAMERA, PA, SCALED, SYNC, cell, markdown_table
from imocap_core.collect.listing import CollectedList, ListedOccurrence
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.io.video import probe
from imocap_core.library.new_action import collect
from imocap_core.pipeline.action import FILE_NAME
from imocap_core.pipeline.runner import Display
from imocap_core.pipeline.source import closure
from imocap_core.workspace import Workspace

# The truth of a collected action, and the same takes as clean clips, for scoring the motion.

TRUTH = "truth.npz"
ROWS = ("joints", "phase", "theta", "trans")


def add_truth(
    folder: Path, collected: CollectedList, films: Mapping[int, Sequence[CutPiece]]
) -> None:
    """Write the truth of a collected action's videos beside it; a mirrored video has none."""
    parts: dict[str, Any] = {"joint_names": np.array(SMPL_JOINTS)}
    ends = []
    for occurrence, place, file in _takes_shown(collected, films):
        with np.load(file.with_suffix(".npz")) as stored:
            take = dict(stored)
        ends.append(float(take["phase"][-1]))
        parts["model"] = take["model"]
        if not place.piece.mirrored:
            rows = _rows(occurrence, place, len(take["phase"]))
            parts |= {f"{occurrence.id}/{name}": take[name][rows] for name in ROWS}
            parts |= {f"{occurrence.id}/{name}": take[name] for name in ("R", "t", "betas")}
            parts[f"{occurrence.id}/K"] = on_canvas(place.piece.zoom) @ take["K"]
            parts[f"{occurrence.id}/frames"] = np.arange(*occurrence.frames)
    parts["phase_end"] = max(ends)
    np.savez(folder / TRUTH, **parts)
    file = folder / FILE_NAME
    file.write_text(f"{file.read_text(encoding='utf-8')}truth: {TRUTH}\n", encoding="utf-8")


def _takes_shown(
    collected: CollectedList, films: Mapping[int, Sequence[CutPiece]]
) -> Iterator[tuple[ListedOccurrence, CutPiece, Path]]:
    """Each chosen occurrence that shows a take, with its piece and the take's file."""
    for occurrence in collected.chosen:
        place = shown_by(occurrence, films[occurrence.film])
        if place is not None and place.piece.file is not None and place.piece.shown is not None:
            yield occurrence, place, place.piece.file


def _rows(occurrence: ListedOccurrence, place: CutPiece, count: int) -> np.ndarray:
    """The take's pictures that the occurrence's frames show."""
    piece = place.piece
    number = np.arange(*occurrence.frames) - place.first + place.source_first
    begin = 0 if piece.span is None else piece.span[0]
    return np.clip(begin + (number // piece.repeat) * piece.step, 0, count - 1)


def on_canvas(zoom: float) -> np.ndarray:
    """Pixels of a compilation from those of a take."""
    right, down = (SIZE[0] - TAKE_SIZE[0] * zoom) / 2, SIZE[1] - TAKE_SIZE[1] * zoom
    return np.array([[zoom, 0, right], [0, zoom, down], [0, 0, 1.0]])


def clean_action(
    folder: Path, collected: CollectedList, films: Mapping[int, Sequence[CutPiece]]
) -> None:
    """The action of the same takes, each a film of its own of which the same part is used, with
    their truth, in a new folder."""
    folder.mkdir(parents=True, exist_ok=True)
    parts: dict[str, Any] = {"joint_names": np.array(SMPL_JOINTS)}
    videos, ends = [], []
    for occurrence, place, file in _takes_shown(collected, films):
        with np.load(file.with_suffix(".npz")) as stored:
            take = dict(stored)
        ends.append(float(take["phase"][-1]))
        parts["model"] = take.pop("model")
        parts |= {f"{occurrence.id}/{name}": value for name, value in take.items()}
        rows = _rows(occurrence, place, len(take["phase"]))
        parts[f"{occurrence.id}/frames"] = np.arange(len(take["phase"]))
        videos.append(
            {
                "id": occurrence.id,
                "video": str(file.resolve()),
                "keypoints": "detect",
                "frames": [int(rows.min()), int(rows.max()) + 1],
            }
        )
    parts["phase_end"] = max(ends)
    np.savez(folder / TRUTH, **parts)
    action = {"name": folder.name, "videos": videos, "truth": TRUTH}
    (folder / FILE_NAME).write_text(yaml.safe_dump(action, sort_keys=False), encoding="utf-8")


# Every action collected from the compilations, scored, and the motion of one of them.

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
    code = [closure(Path(__file__).with_name(name)) for name in ("collect_edit.py",)]
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


NAME = "collect"


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The tables as Markdown, and what was written."""
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    folder.mkdir(parents=True, exist_ok=True)
    scores = measure(workspace, folder, display, run=options.variants != ("lists",))
    text = markdown(scores)
    (folder / "table.md").write_text(text, encoding="utf-8")
    write_numbers(scores, folder / "numbers.json")
    return [text, f"Written to {folder}"]


def markdown(scores: CollectScores) -> str:
    """The whole report."""
    parts = [
        "# Actions collected from compilations",
        f"Made by `imocap benchmark collect`: two films of {scores.shots} shots, made of rendered "
        "takes and real videos.",
        "## Shot boundaries",
        markdown_table(
            ["", "there", "found", "false"],
            [_boundary_row(kind, tally) for kind, tally in scores.boundaries.items()],
        ),
        "## Occurrences",
        markdown_table(
            ["looked for", "shots", "found", "false", "recall", "precision", "replays", "false",
             "mirrored", "false", "videos"],
            [
                [
                    a.action if a.example else f"most repeated ({a.action})",
                    *_cells(a.occurrences),
                    _share(a.occurrences.recall),
                    _share(a.occurrences.precision),
                    f"{a.replays.found_right} of {a.replays.there}",
                    str(a.replays.wrong),
                    f"{a.mirrored.found_right} of {a.mirrored.there}",
                    str(a.mirrored.wrong),
                    str(a.videos),
                ]
                for a in scores.actions
            ],
        ),
    ]  # fmt: skip
    if scores.motion:
        parts += ["## Motion", _motion_table(scores.motion)]
    return "\n\n".join(parts) + "\n"


def _boundary_row(kind: str, tally: Tally) -> list[str]:
    wrong = str(tally.wrong) if kind == "all" else ""
    return [kind, str(tally.there), str(tally.found_right), wrong]


def _cells(tally: Tally) -> list[str]:
    return [str(tally.there), str(tally.found_right), str(tally.wrong)]


def _share(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.0%}"


def _motion_table(motion: dict[str, ActionScore]) -> str:
    head = ["", "videos", "frames", "MPJPE mm", "PA-MPJPE mm", "sync error %", "cameras deg"]
    rows = [
        [
            name,
            str(score.videos),
            str(score.frames),
            *(cell(score.of("after loop", metric), 1) for metric in (SCALED, PA, SYNC, CAMERA)),
        ]
        for name, score in motion.items()
    ]
    return markdown_table(head, rows)
