"""`imocap benchmark stability`."""

from __future__ import annotations

from rich.table import Table

from benchmarks.names import BenchmarkOptions
from benchmarks.stability.measure import measure
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The tables as Markdown, and what was written."""
    text, folder = measure(workspace, options.only, display, options.jobs)
    return [text, f"Written to {folder}"]
