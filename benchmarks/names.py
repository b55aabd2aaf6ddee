"""`imocap benchmark NAME`: which measurement each name is.

Each is a file of its name, the sets of MOTION are benchmarks/motion.py. It has a function

    report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]

which measures, writes its tables, and returns what the command prints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
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
MOTION = ("protocol", "trials", "yoga", "real", "h36m")  # the sets of benchmarks/motion.py


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
    module = "motion" if name in MOTION else name
    report: Report = import_module(f"benchmarks.{module}").report
    return report
