"""`imocap benchmark degraded`."""

from __future__ import annotations

from rich.table import Table

from benchmarks.degraded.measure import NAME, measure
from benchmarks.docs import check_marks, docs_sentences
from benchmarks.names import BenchmarkOptions
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    if options.docs:
        check_marks(workspace.root, NAME)
    text, folder = measure(workspace, options.only, options.variants, display, options.jobs)
    lines = [text, f"Written to {folder}"]
    if options.docs:
        lines += docs_sentences(workspace.root, NAME, text)
    return [*lines]
