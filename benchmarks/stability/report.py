"""`imocap benchmark stability`."""

from __future__ import annotations

from rich.table import Table

from benchmarks.docs import check_marks, docs_sentences
from benchmarks.names import BenchmarkOptions
from benchmarks.stability.measure import NAME, measure
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The tables as Markdown, and what was written."""
    if options.docs:
        check_marks(workspace.root, NAME)
    text, folder = measure(workspace, options.only, display, options.jobs)
    lines = [text, f"Written to {folder}"]
    if options.docs:
        lines += docs_sentences(workspace.root, NAME, text)
    return [*lines]
