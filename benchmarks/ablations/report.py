"""`imocap benchmark ablations`."""

from __future__ import annotations

from rich.table import Table

from benchmarks.ablations.measure import measure
from benchmarks.ablations.tables import markdown
from benchmarks.actions.choice import Choice
from benchmarks.names import BenchmarkOptions
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    if (options.detector, options.videos) != ("fine_tuned", 4):
        raise WrongUse("ablations set --detector and --videos themselves; leave both out")
    base = Choice(options.on, sampling=options.sampling, only=options.only, data=options.data)
    table, folder = measure(workspace, base, options.variants, display, options.jobs)
    text = markdown(table)
    return [text, f"Written to {folder}"]
