"""`imocap benchmark NAME`: which measurement each name is.

Every folder of MEASUREMENTS has a module `report` with a function

    report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]

which measures, writes its tables, and returns what the command prints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from imocap_core.pipeline.runner import Display
    from imocap_core.workspace import Workspace

BenchmarkName = Literal[
    "protocol",
    "trials",
    "yoga",
    "real",
    "h36m",
    "rendered",
    "detector",
    "degraded",
    "collect",
    "stability",
    "ablations",
    "sync",
    "screening",
    "wrong_start",
    "performers",
    "performances",
    "angles",
    "chance",
    "moving_camera",
    "event",
    "field",
    "penn",
    "solver",
    "cost",
    "speed",
    "lifter",
    "bones",
]
MEASUREMENTS: dict[BenchmarkName, str] = {  # name -> folder of benchmarks/
    "protocol": "motion",
    "trials": "motion",
    "yoga": "motion",
    "real": "motion",
    "h36m": "motion",
    "rendered": "rendered",
    "detector": "detector",
    "degraded": "degraded",
    "collect": "collect",
    "stability": "stability",
    "ablations": "ablations",
    "sync": "sync",
    "screening": "screening",
    "wrong_start": "wrong_start",
    "performers": "performers",
    "performances": "performances",
    "angles": "angles",
    "chance": "chance",
    "moving_camera": "moving_camera",
    "event": "event",
    "field": "field",
    "penn": "penn",
    "solver": "solver",
    "cost": "cost",
    "speed": "speed",
    "lifter": "lifter",
    "bones": "body",
}


@dataclass(frozen=True)
class BenchmarkOptions:
    """The options of one `imocap benchmark`; README.md says which of them a measurement reads."""

    name: BenchmarkName
    detector: str = "fine_tuned"
    sampling: str = "released"
    videos: int = 4
    only: tuple[str, ...] = ()
    on: str = "trials"
    variants: tuple[str, ...] = ()
    data: Path | None = None
    jobs: int = 1
    small: bool = False


Report = Callable[[BenchmarkOptions, "Workspace", "Display"], "list[Table | str]"]


def report_of(name: BenchmarkName) -> Report:
    """The measurement of a name."""
    report: Report = import_module(f"benchmarks.{MEASUREMENTS[name]}.report").report
    return report


def table_of_rows(rows: Sequence[Any]) -> Table:
    """Dataclass instances as a table for the terminal: a column a field, two decimals."""
    from rich.table import Table

    fields = [asdict(row) for row in rows]
    table = Table(*fields[0], box=None, pad_edge=False)
    for row in fields:
        table.add_row(*(f"{v:.2f}" if isinstance(v, float) else str(v) for v in row.values()))
    return table
