"""`imocap benchmark trust`: are videos of another action, and mirrored ones, detected?"""

from __future__ import annotations

from rich.table import Table

from benchmarks.names import BenchmarkOptions, table_of_rows
from benchmarks.trust.poses import fitted, true_poses
from benchmarks.trust.screened import among_decidable, measure, totals
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """A table of the monocular fits, one of the true poses, and the totals."""
    max_rate = workspace.pipeline().params.sync.max_rate
    fits = measure(fitted(workspace, display), max_rate)
    true = measure(true_poses(workspace), max_rate)
    lines = [*totals(fits, "monocular fits"), *totals(true, "true poses")]
    return [table_of_rows(fits), table_of_rows(true), *lines, *among_decidable(fits, true)]
