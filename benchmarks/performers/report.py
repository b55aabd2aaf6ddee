"""`imocap benchmark performers`: one action by two people, declared, not declared, and apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from benchmarks.actions.captured import data_folder
from benchmarks.names import BenchmarkOptions, table_of_rows
from benchmarks.performers.measure import RUNS, PerformerRow, measured
from benchmarks.tables import cell, markdown_table, write_rows, write_texts
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

NAME = "performers"
FILES = (("trials", "cmu_walk_s07"), ("performers", "cmu_walk_s08"))  # of the two performers
VIDEOS = 3  # of each
HEAD = (
    *("run", "performer", "MPJPE scaled (mm)", "P-MPJPE (mm)", "limbs' proportions (%)"),
    "cameras (deg)",
)


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """A row for every run and performer, and the means of the runs."""
    files = [data_folder(workspace.root, kind) / f"{name}.npz" for kind, name in FILES]
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    rows = measured(folder, files, VIDEOS, options.detector, display)
    text = markdown(rows)
    write_rows(folder, "results", rows)
    write_texts(folder, {"table.md": text})
    return [table_of_rows(rows), summary(rows), f"Written to {folder}"]


def markdown(rows: Sequence[PerformerRow]) -> str:
    """The summary and the table."""
    cells = [
        [
            row.run,
            row.performer,
            cell(row.mpjpe_scaled_mm, 1),
            cell(row.pa_mpjpe_mm, 1),
            cell(row.proportions_pct, 2),
            cell(row.camera_deg, 1),
        ]
        for row in rows
    ]
    return f"{summary(rows)}\n\n{markdown_table(HEAD, cells)}\n"


def summary(rows: Sequence[PerformerRow]) -> str:
    """Means over the performers of every run."""
    parts = []
    for run in RUNS:
        of_run = [row for row in rows if row.run == run]
        error = np.mean([row.mpjpe_scaled_mm for row in of_run])
        shape = np.mean([row.proportions_pct for row in of_run])
        parts.append(f"{run} {error:.1f} mm and {shape:.1f} %")
    return f"Mean scaled MPJPE and error of the limbs' proportions: {'; '.join(parts)}."
