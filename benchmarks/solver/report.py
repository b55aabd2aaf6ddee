"""`imocap benchmark solver`."""

from __future__ import annotations

from rich.table import Table

from benchmarks.names import BenchmarkOptions
from benchmarks.solver.measure import measure
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    folder = workspace.root / "artifacts" / "benchmark" / "solver"
    text = measure(workspace, options.only, display, folder)
    return [text, f"Written to {folder}"]
