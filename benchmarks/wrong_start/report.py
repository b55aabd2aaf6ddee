"""`imocap benchmark wrong_start`: is a wrongly started view recovered by the others?"""

from __future__ import annotations

from rich.table import Table

from benchmarks.actions.choice import Choice
from benchmarks.actions.prepare import chosen_names
from benchmarks.names import BenchmarkOptions, table_of_rows
from benchmarks.wrong_start import hypotheses
from benchmarks.wrong_start.measure import measure_action, summary
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """Results of all actions with how many were recovered, and each video's motions."""
    choice = Choice("trials", options.detector, videos=options.videos, only=options.only)
    actions = [
        measure_action(workspace, choice, name, display)
        for name in chosen_names(workspace.root, choice)
    ]
    rows = [row for action in actions for row in action.results]
    motions = [row for action in actions for row in action.hypotheses]
    return [
        *(table_of_rows(rows), summary(rows)),
        *(table_of_rows(motions), hypotheses.summary(motions)),
    ]
