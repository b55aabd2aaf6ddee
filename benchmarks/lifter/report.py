"""`imocap benchmark lifter`."""

from __future__ import annotations

from rich.table import Table

from benchmarks.lifter.measure import markdown, measure, write_table
from benchmarks.names import BenchmarkOptions
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and where it was written."""
    rows = measure(workspace, options.only, display)
    file = write_table(rows, workspace.root / "artifacts" / "benchmark" / "lifter")
    return [markdown(rows), f"Written to {file}"]
