"""`imocap benchmark cost`: a model of time, memory and storage, fitted to made actions."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from benchmarks.cost.action import ActionSize
from benchmarks.cost.bookkeeping import bookkeeping
from benchmarks.cost.measure import measured
from benchmarks.cost.models import models_of, of_actions, size_of
from benchmarks.cost.scale import scaled
from benchmarks.cost.tables import (
    MEGABYTES,
    SECONDS,
    bookkeeping_text,
    model_table,
    prediction_table,
    scale_text,
)
from benchmarks.names import BenchmarkOptions
from benchmarks.tables import DETAILS, write_rows, write_texts
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

NAME = "cost"
FITTED = (
    *(ActionSize(*size) for size in ((2, 100), (2, 300), (4, 150), (8, 150), (4, 600))),
    ActionSize(4, 150, "coco18"),
    ActionSize(16, 300),
    ActionSize(8, 1000),
)
HELD_OUT = (ActionSize(3, 400), ActionSize(6, 250))
ACTIONS, SIZE, MACHINES = (20, 1_000, 10_000), (8, 300, 25), 10


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """Measure what was not (`--only 4x150-body25` for some sizes), and fit."""
    names = {size.name: size for size in (*FITTED, *HELD_OUT)}
    for name in options.only:
        if name not in names:
            raise WrongUse(f"--only {name}: expected one of {', '.join(names)}")
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    if options.only:
        rows = measured(folder, [names[name] for name in options.only])
        write_rows(folder, "some", rows)
        return [f"Measured: {', '.join(options.only)}", f"Written to {folder}"]
    text = text_of(folder)
    write_texts(folder, {"table.md": text})
    return [text, f"Written to {folder}"]


def text_of(folder: Path) -> str:
    """Measured and predicted costs, the models, and thousands of actions."""
    fitted_rows, held_out_rows = measured(folder, FITTED), measured(folder, HELD_OUT)
    write_rows(folder, "stages", [*fitted_rows, *held_out_rows])
    models = models_of(fitted_rows)
    actions = of_actions([*fitted_rows, *held_out_rows])
    held_out = [size_of(row) for row in held_out_rows]
    costs = [scaled(models, count, SIZE) for count in ACTIONS]
    parts = (
        "## Whole actions, measured and predicted",
        prediction_table(actions, models, held_out),
        "## Many actions",
        scale_text(costs, SIZE, MACHINES),
        DETAILS,
        "## Processor time of each stage",
        model_table(models.processor_s, SECONDS),
        "## Stored by each stage",
        model_table(models.stored_mb, MEGABYTES),
        "## What a task pays for the other actions of its folder",
        bookkeeping_text(bookkeeping(folder)),
    )
    return "\n\n".join(parts) + "\n"
