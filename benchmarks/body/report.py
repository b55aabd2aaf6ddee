"""`imocap benchmark bones`: the body's fit to measured skeletons."""

from __future__ import annotations

from rich.table import Table

from benchmarks.actions.captured import data_folder
from benchmarks.body import bones
from benchmarks.names import BenchmarkOptions, table_of_rows
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table."""
    return [table_of_rows(bones.measure(data_folder(workspace.root, "trials")))]
