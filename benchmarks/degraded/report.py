"""`imocap benchmark degraded`."""

from __future__ import annotations

from rich.table import Table

from benchmarks.degraded.measure import measure
from benchmarks.names import BenchmarkOptions
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    text, folder = measure(workspace, options.only, options.variants, display, options.jobs)
    return [text, f"Written to {folder}"]
