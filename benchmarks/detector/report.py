"""`imocap benchmark detector`."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from benchmarks.actions.captured import data_folder
from benchmarks.detector.degradations import DEGRADATIONS
from benchmarks.detector.measure import DetectorScore, measure
from benchmarks.names import BenchmarkOptions
from benchmarks.tables import cell, markdown_table, write_texts
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

NAME = "detector"
ACTIONS = ("balance_beam", "crowd")
FRAMES, FRAMES_SMALL = 100, 40  # of each video
HEAD = (
    *("action", "footage", "performer followed %", "error, % of the height"),
    *("PCK .2", "PCK .1", "swapped bodies", "ms a frame"),
)


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    names = [d.name for d in DEGRADATIONS]
    unknown = [name for name in options.only if name not in ACTIONS]
    unknown += [name for name in options.variants if name not in names]
    if unknown:
        expected = ", ".join((*ACTIONS, *names))
        raise WrongUse(f"{unknown[0]}: expected an action or a degradation, of {expected}")
    scores: list[DetectorScore] = []
    for action in ACTIONS:
        if options.only and action not in options.only:
            continue
        folder = data_folder(workspace.root, action)
        if not (folder / "videos").is_dir():
            raise WorkFailed(f"{folder}: expected a folder of videos; IMOCAP_DATA names the data")
        frames = FRAMES_SMALL if options.small else FRAMES
        scores += measure(action, folder, frames, options.variants, display)
    text = markdown(scores)
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    write_texts(folder, {"table.md": text})
    return [text, f"Written to {folder}"]


def markdown(scores: Sequence[DetectorScore]) -> str:
    """The whole report."""
    rows = [
        [
            score.action,
            score.footage,
            *(cell(v, 1) for v in (score.followed_pct, score.error_pct, score.pck_2, score.pck_1)),
            str(score.swapped),
            cell(score.ms, 0),
        ]
        for score in scores
    ]
    return (
        "# The detector on degraded footage\n\nMade by `imocap benchmark detector`. The reference "
        "is a calibrated triangulation of other detections; the performer is the person with the "
        "largest presence, size and motion, and followed where the mean error is below 10 % of "
        "the height. Missing joints count as wrong in PCK. Milliseconds are of the worker, without "
        "decoding.\n\n" + markdown_table(HEAD, rows) + "\n"
    )
