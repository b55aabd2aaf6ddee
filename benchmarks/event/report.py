"""`imocap benchmark event`: cameras calibrated from films of one performance, and not."""

from __future__ import annotations

from rich.table import Table

from benchmarks.event.events import EVENTS, event_errors
from benchmarks.names import BenchmarkOptions, table_of_rows
from benchmarks.tables import write_rows
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """Every event (`--only NAME` for some), declared as one."""
    for name in options.only:
        if name not in EVENTS:
            raise WrongUse(f"--only {name}: expected one of {', '.join(EVENTS)}")
    rows = []
    for name in options.only or EVENTS:
        rows.append(event_errors(display, workspace.root, name))
    folder = workspace.root / "artifacts" / "benchmark" / "event"
    write_rows(folder, "events", rows)
    return [table_of_rows(rows), f"Written to {folder}"]
