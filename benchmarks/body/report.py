"""`imocap benchmark body` (speed) and `bones` (fit to measured skeletons)."""

from __future__ import annotations

from rich.table import Table

from benchmarks.actions.captured import data_folder
from benchmarks.names import BenchmarkOptions, table_of_rows
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table."""
    if options.name == "body":
        from benchmarks.body import speed

        return [table_of_rows(speed.measure())]
    from benchmarks.body import bones

    return [table_of_rows(bones.measure(data_folder(workspace.root, "trials")))]
