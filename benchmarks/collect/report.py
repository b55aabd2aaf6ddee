"""`imocap benchmark collect`."""

from __future__ import annotations

import math

from rich.table import Table

from benchmarks.collect.measure import CollectScores, measure, write_numbers
from benchmarks.collect.truth import Tally
from benchmarks.names import BenchmarkOptions
from benchmarks.scoring.score_file import ActionScore
from benchmarks.tables import CAMERA, PA, SCALED, SYNC, cell, markdown_table
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

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
