"""`imocap benchmark protocol`, `trials`, `yoga` and `h36m`."""

from __future__ import annotations

from rich.table import Table

from benchmarks.actions.choice import Choice
from benchmarks.motion.measure import measure
from benchmarks.motion.tables import markdown
from benchmarks.names import BenchmarkOptions
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    if options.variants:
        raise WrongUse("--variants: only for `imocap benchmark ablations` and `sync`")
    choice = Choice(
        options.name,
        options.detector,
        options.sampling,
        options.videos,
        options.only,
        data=options.data,
    )
    benchmark, folder = measure(workspace, choice, display, options.jobs)
    text = markdown(benchmark)
    return [text, f"Written to {folder}"]
