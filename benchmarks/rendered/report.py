"""`imocap benchmark rendered`."""

from __future__ import annotations

from rich.table import Table

from benchmarks.docs import check_marks, docs_sentences
from benchmarks.names import BenchmarkOptions
from benchmarks.rendered.jobs import RenderedChoice
from benchmarks.rendered.measure import measure
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The tables as Markdown, and what was written."""
    choice = RenderedChoice(options.videos, options.small, options.only)
    if options.docs:
        check_marks(workspace.root, choice.label)
    text, folder = measure(workspace, choice, display, options.jobs)
    lines = [text, f"Written to {folder}"]
    if options.docs:
        lines += docs_sentences(workspace.root, choice.label, text)
    return [*lines]
