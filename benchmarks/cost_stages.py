"""Processor time, peak memory and stored bytes of every stage of one made action.

Every size runs in a process of its own, all its stages and the report, and its rows are stored:
what was measured once is not measured again.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.cost_action import ActionSize, make_sized_action
from benchmarks.parallel import ForwardingDisplay, LineDisplay, in_process
from imocap_core.artifacts.store import CACHE, cached_results, sweep
from imocap_core.body.layouts import layout_names
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Outcome
from imocap_core.process import configure_process, peak_bytes, restart_peak
from imocap_core.report.action_report import finish
from imocap_core.workspace import Workspace

REPORT = "report"
PROBE_SIZE, PROBE_TIMES = 300, 40


@dataclass(frozen=True)
class StageCost:
    """What one stage of one action took.

    processor_s: seconds of all cores together; seconds: on the clock. peak_mb: the process's
    largest memory meanwhile, what earlier stages left in it included. stored_mb: of its artifact;
    of `report`: of all its files. probe_ms: processor time of a fixed computation, just before.
    """

    videos: int
    frames: int
    keypoints: int
    stage: str
    processor_s: float
    seconds: float
    peak_mb: float
    stored_mb: float
    probe_ms: float


@dataclass
class CostTimer(ForwardingDisplay):
    """A display that also records what every stage takes."""

    size: ActionSize
    rows: list[StageCost] = field(default_factory=list)
    _began: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def started(self, stage: str, why: list[str]) -> None:
        """Start the clocks."""
        self.display.started(stage, why)
        self.begin()

    def finished(self, outcome: Outcome) -> None:
        """Record it."""
        self.end(outcome.stage, outcome.stored.file.stat().st_size)
        self.display.finished(outcome)

    def begin(self) -> None:
        """Start the clocks and the peak of memory."""
        probe_ms = machine_probe_ms()
        restart_peak()
        self._began = time.perf_counter(), processor_seconds(), probe_ms

    def end(self, stage: str, stored: int) -> None:
        """A row of what has been used since `begin`. stored: bytes."""
        began, processor, probe_ms = self._began
        self.rows.append(
            StageCost(
                self.size.videos,
                self.size.frames,
                len(layout_names(self.size.layout)),
                stage,
                processor_seconds() - processor,
                time.perf_counter() - began,
                (peak_bytes() or 0) / 1e6,
                stored / 1e6,
                probe_ms,
            )
        )


def processor_seconds() -> float:
    """Of this process, all its threads, and the processes that it started and that ended."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def machine_probe_ms() -> float:
    """Processor time of a fixed computation: how fast the machine is under its present load."""
    matrix = np.random.default_rng(0).normal(size=(PROBE_SIZE, PROBE_SIZE))
    began = time.process_time()
    for _ in range(PROBE_TIMES):
        np.linalg.cholesky(matrix @ matrix.T + PROBE_SIZE * np.eye(PROBE_SIZE))
    return 1e3 * (time.process_time() - began) / PROBE_TIMES


def measured(folder: Path, sizes: Sequence[ActionSize]) -> list[StageCost]:
    """The rows of all sizes; those that `folder` has not are measured, one size after another."""
    rows = []
    for size in sizes:
        file = folder / "rows" / f"{size.name}.json"
        if not file.is_file():
            make_sized_action(folder / "actions" / size.name, size)
            costs = in_process(measure_action, (folder, size), 1)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps([asdict(row) for row in costs], indent=1) + "\n")
        rows += [StageCost(**row) for row in json.loads(file.read_text(encoding="utf-8"))]
    return rows


def measure_action(root: Path, size: ActionSize) -> list[StageCost]:
    """Every stage and the report of a made action, in this process."""
    configure_process()
    timer = CostTimer(LineDisplay(), size)
    job = Workspace(root).ready_job(size.name, [], timer)

    def report(outcomes: list[Outcome]) -> None:
        timer.begin()
        page = finish(job, outcomes)
        files = [] if page is None else [p for p in page.parent.rglob("*") if p.is_file()]
        timer.end(REPORT, sum(file.stat().st_size for file in files))

    stages = list(job.pipeline.stages)
    runner.run(job, timer, stages, frozenset(stages), report)
    return timer.rows


# What a task of `run-all` pays for the other actions of its working folder.
#
# A folder of empty results is made; what is done in it besides the stages is timed: every task
# sweeps leftovers, reads and saves what is remembered of files; once a run the cache is measured
# against its limit.

ACTIONS = (100, 1000)
STAGES, REPORT_FILES, REMEMBERED = 9, 30, 16  # of an action; remembered: videos and keypoints


@dataclass(frozen=True)
class BookkeepingRow:
    """Processor milliseconds in a folder of so many actions: of one task, and once (limit_ms)."""

    actions: int
    sweep_ms: float
    limit_ms: float
    memory_ms: float


def bookkeeping(place: Path) -> list[BookkeepingRow]:
    """A row for each of ACTIONS, in temporary folders below `place`."""
    rows = []
    place.mkdir(parents=True, exist_ok=True)
    for actions in ACTIONS:
        with tempfile.TemporaryDirectory(dir=place) as folder:
            store = Path(folder)
            make_store(store, actions)
            times = (
                _processor_ms(partial(sweep, store, "a0")),
                _processor_ms(partial(cached_results, store)),
                _processor_ms(partial(_written_and_read, remembered(actions))),
            )
            rows.append(BookkeepingRow(actions, *times))
    return rows


def make_store(store: Path, actions: int) -> None:
    """Empty results of so many actions, each linked from the cache as a run does it."""
    for stage in range(STAGES):
        (store / CACHE / f"s{stage}").mkdir(parents=True)
    for a in range(actions):
        report = store / f"a{a}" / "report"
        report.mkdir(parents=True)
        for k in range(REPORT_FILES):
            (report / f"{k}.png").touch()
        lines = [f"s{stage}/{a:064d}" for stage in range(STAGES)]
        for line in lines:
            cached = store / CACHE / f"{line}.mcap"
            cached.touch()
            os.link(cached, store / f"a{a}" / f"{line.partition('/')[0]}.mcap")


def remembered(actions: int) -> dict[str, tuple[str, str]]:
    """What of files.json grows with the actions: their videos and keypoints."""
    return {
        f"content /home/lab/actions/action_{a}/videos/v{k}.mp4": ("1234567 " * 3, "0" * 64)
        for a in range(actions)
        for k in range(REMEMBERED)
    }


def _written_and_read(entries: dict[str, tuple[str, str]]) -> object:
    return json.loads(json.dumps(entries))


def _processor_ms(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return 1e3 * (time.process_time() - began)
