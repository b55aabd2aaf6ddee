"""`imocap benchmark solver`."""

from __future__ import annotations

from rich.table import Table

from benchmarks.docs import check_marks, docs_sentences
from benchmarks.names import BenchmarkOptions
from benchmarks.solver.measure import measure
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    if options.docs:
        check_marks(workspace.root, "solver")
    folder = workspace.root / "artifacts" / "benchmark" / "solver"
    text = measure(workspace, options.only, display, folder)
    lines = [text, f"Written to {folder}"]
    if options.docs:
        lines += docs_sentences(workspace.root, "solver", text)
    return [*lines]
