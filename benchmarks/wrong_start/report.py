"""`imocap benchmark wrong_start`: is a wrongly started view recovered by the others?"""

from __future__ import annotations

from rich.table import Table

from benchmarks.actions.choice import Choice
from benchmarks.actions.prepare import chosen_names
from benchmarks.names import BenchmarkOptions, table_of_rows
from benchmarks.wrong_start.measure import measure_action, summary
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """A table of all actions, and how many views were recovered."""
    choice = Choice("trials", options.detector, videos=options.videos, only=options.only)
    rows = [
        row
        for name in chosen_names(workspace.root, choice)
        for row in measure_action(workspace, choice, name, display)
    ]
    return [table_of_rows(rows), summary(rows)]
