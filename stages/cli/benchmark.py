"""benchmark: measurements by name, as tables on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.table import Table

from stages.benchmarks.inputs import data_folder
from stages.harness.workspace import Workspace


def body_table(name: str, workspace: Workspace) -> Table:
    """The body's speed (`body`) or how well its bones fit measured skeletons (`bones`)."""
    rows: Sequence[Any]
    if name == "body":
        from stages.benchmarks.body import measure as speed

        rows = speed()
    else:
        from stages.benchmarks.bones import measure as fit

        rows = fit(data_folder(workspace.root, "trials"))
    told = [asdict(row) for row in rows]
    table = Table(*told[0], box=None, pad_edge=False)
    for row in told:
        table.add_row(*(f"{v:.2f}" if isinstance(v, float) else str(v) for v in row.values()))
    return table
