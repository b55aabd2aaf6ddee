"""`imocap benchmark speed`: ratios to named alternatives, run beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from rich.table import Table
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from benchmarks.names import BenchmarkOptions
from benchmarks.solver.race import one_core
from benchmarks.speed import contests
from benchmarks.speed.contest import RatioRow
from benchmarks.tables import ABSENT, DETAILS, cell, markdown_table, write_rows, write_texts
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

NAME = "speed"
HEAD = (
    *("part", "beside", "size", "ours (ms)", "it (ms)", "times as long"),
    *("growth, ours", "growth, it"),
)


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """All contests (`--only affinity` for some), one core, processor time."""
    pipeline = workspace.pipeline()
    params = pipeline.params
    parts: dict[str, Callable[[], list[RatioRow]]] = {
        "affinity": contests.affinity,
        "cycle": lambda: contests.cycle_consistency(params.sync),
        "dtw": contests.time_warping,
        "body": contests.body_jacobian,
        "solver": lambda: contests.solver(params.fit, params.motion, pipeline.seed),
        "motion": lambda: contests.motion_alone_solvers(params.fit, params.motion, pipeline.seed),
        "pipeline": contests.pipeline,
    }
    if unknown := sorted(set(options.only) - set(parts)):
        raise WrongUse(f"--only {unknown[0]}: expected some of {', '.join(parts)}")
    rows = []
    with one_core(), threadpool_limits(1):
        for name in options.only or parts:
            rows += parts[name]()
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    text = f"{summary(rows)}\n{DETAILS}\n\n{markdown(rows)}"
    write_rows(folder, "results", rows)
    write_texts(folder, {"table.md": text})
    return [text, f"Written to {folder}"]


def markdown(rows: Sequence[RatioRow]) -> str:
    """The table; a rival that was stopped took more than the multiple that it has."""
    cells = [
        [
            row.part,
            row.rival,
            row.size,
            _thousands(row.ours_ms),
            f"{'> ' if row.at_least else ''}{_thousands(row.rival_ms)}",
            f"{'> ' if row.at_least else ''}{_ratio(row.ratio)}",
            cell(row.growth, 1),
            cell(math.nan if row.at_least else row.rival_growth, 1),
        ]
        for row in rows
    ]
    return markdown_table(HEAD, cells) + "\n"


def summary(rows: Sequence[RatioRow]) -> str:
    """The ratio at the larger size of every contest."""
    largest = {(row.part, row.rival): row for row in rows if not math.isnan(row.ratio)}
    cells = [
        [row.part, row.rival, row.size, f"{'> ' if row.at_least else ''}{_ratio(row.ratio)}"]
        for row in largest.values()
    ]
    return markdown_table(HEAD[:3] + HEAD[5:6], cells) + "\n"


def _ratio(value: float) -> str:
    if math.isnan(value):
        return ABSENT
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _thousands(value: float) -> str:
    return ABSENT if math.isnan(value) else f"{value:,.1f}"
