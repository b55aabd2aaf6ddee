"""What `make measure` measures: each table of the documentation, its command, and what it needs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.actions.captured import data_base
from benchmarks.docs import essentials
from benchmarks.rendered.names import check_detector
from benchmarks.tables import markdown_table
from imocap_core.errors import WorkFailed

PYTHON, IMOCAP = "python", "imocap"  # first word of a command: of the environment that runs it


@dataclass(frozen=True)
class Measurement:
    """One command, and the table that it leaves.

    table: its name between the marks of the documentation, and its folder below
    artifacts/benchmark unless `made` says otherwise. data: folders that it needs.
    detected: whether it needs the detector's environment. in_parallel: whether it takes `--jobs`.
    """

    table: str
    command: tuple[str, ...]
    data: tuple[str, ...] = ()
    detected: bool = False
    in_parallel: bool = False
    made: str = ""
    read: Callable[[str], str] = essentials

    def file(self, root: Path) -> Path:
        """What the command writes last."""
        return root / (self.made or f"artifacts/benchmark/{self.table}/table.md")

    def lacks(self, root: Path) -> str:
        """Why it cannot be run here; empty when it can."""
        for name in self.data:
            if not (folder := data_base(root) / name).is_dir():
                return f"{folder} does not exist (IMOCAP_DATA names the folder of all data)"
        try:
            if self.detected:
                check_detector(root)
        except WorkFailed as error:
            return str(error)
        return ""


def fuzz_table(record: str) -> str:
    """Executions of damaged files, and how many were neither read nor refused in time."""
    became = json.loads(record)["became"]
    lost = [n for row in became.values() for how, n in row.items() if how not in OUTCOMES]
    tried = sum(n for row in became.values() for n in row.values())
    cells = [[f"damaged files of {len(became)} readers", f"{tried:,}", str(sum(lost))]]
    return markdown_table(ROBUSTNESS, cells)


def chaos_table(record: str) -> str:
    """Each disturbance: how often it was tried, and how often something was lost."""
    parts = json.loads(record)
    cells = [[name, f"{part['tried']:,}", str(part["lost"])] for name, part in parts.items()]
    return markdown_table(ROBUSTNESS, cells)


OUTCOMES = ("read", "refused")
ROBUSTNESS = ("tried", "times", "lost")


def _benchmark(
    words: str, table: str = "", *data: str, detected: bool = False, in_parallel: bool = False,
    made: str = "",
) -> Measurement:  # fmt: skip
    command = (IMOCAP, "benchmark", *words.split())
    return Measurement(table or words, command, data, detected, in_parallel, made)


PLAN = (  # the shorter ones first
    _benchmark("speed"),
    _benchmark("yoga"),
    _benchmark("solver"),
    _benchmark("performers", "", "trials", "performers"),
    _benchmark("real", "", "balance_beam", "crowd", detected=True),
    _benchmark("detector", "", "balance_beam", "crowd", detected=True),
    _benchmark("field", "", "field", in_parallel=True),
    _benchmark("protocol", "protocol-released-fine_tuned-4v", "protocol", in_parallel=True),
    _benchmark("trials", "trials-fine_tuned-4v", "trials", in_parallel=True),
    _benchmark("rendered", "rendered-4v", "trials", detected=True, in_parallel=True),
    _benchmark(
        "performances", "", "performances",
        made="artifacts/benchmark/performances-fine_tuned/results.md",
    ),
    _benchmark("angles", "", "trials", made="artifacts/benchmark/angles-fine_tuned/results.md"),
    _benchmark("collect", "", "trials", "balance_beam", detected=True),
    _benchmark("moving_camera"),
    _benchmark("degraded", "", "balance_beam", "crowd", detected=True, in_parallel=True),
    _benchmark("penn --videos 10", "penn", "penn", in_parallel=True),
    _benchmark("screening", "", "train", in_parallel=True),
    _benchmark(
        "wrong_start", "", "trials", detected=True, in_parallel=True,
        made="artifacts/benchmark/trials-fine_tuned-4v/wrong_start/table.md",
    ),
    _benchmark("stability", "", "trials", "balance_beam", detected=True, in_parallel=True),
    _benchmark("cost"),
    _benchmark("ablations --on trials", "ablations-trials", "trials", in_parallel=True),
    Measurement(
        "fuzz", (PYTHON, "-m", "tools.fuzz.run", "--seconds", "1800"),
        made="build/fuzz/record.json", read=fuzz_table,
    ),
    Measurement(
        "chaos", (PYTHON, "-m", "tools.chaos.run", "--kills", "100"),
        made="build/chaos.json", read=chaos_table,
    ),
)  # fmt: skip
