"""The cost of each stage's artifact when it was made, stored so that a cached run can report it.

Measured in this process; a figure depends on the machine and its load at that time.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.parallel import ForwardingDisplay
from imocap_core.pipeline.runner import Outcome

STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Cost:
    """Wall time, and the peak of the process's memory in that time."""

    seconds: float
    peak_gb: float


@dataclass
class Meter(ForwardingDisplay):
    """A display that also stores the cost of each stage in `folder`, a file an artifact."""

    folder: Path
    _began: float = field(default=0.0, init=False)

    def started(self, stage: str, why: list[str]) -> None:
        reset_peak()
        self._began = time.perf_counter()
        self.display.started(stage, why)

    def finished(self, outcome: Outcome) -> None:
        if outcome.how == "made":
            self.record(outcome.stored.key, Cost(time.perf_counter() - self._began, peak_gb()))
        self.display.finished(outcome)

    @contextmanager
    def measuring(self, name: str, costs: dict[str, Cost]) -> Iterator[None]:
        """Measure the body of the `with` statement; its cost becomes `costs[name]`."""
        reset_peak()
        began = time.perf_counter()
        yield
        costs[name] = Cost(time.perf_counter() - began, peak_gb())

    def record(self, key: str, cost: Cost) -> None:
        """Store the cost of the artifact with a stage key."""
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / key).write_text(json.dumps([cost.seconds, cost.peak_gb]))

    def costs(self, outcomes: Sequence[Outcome]) -> dict[str, Cost]:
        """Stage -> cost, of the artifacts that were measured when they were made."""
        costs = {}
        for outcome in outcomes:
            with suppress(OSError, ValueError, TypeError):
                written = (self.folder / outcome.stored.key).read_text()
                costs[outcome.stage] = Cost(*json.loads(written))
        return costs


def reset_peak() -> None:
    """Start the peak of memory again from what is in use now, where the system can."""
    with suppress(OSError):
        CLEAR.write_text("5")


def peak_gb() -> float:
    """Peak of memory since `reset_peak`, or since the process began where it can't be reset."""
    with suppress(OSError, StopIteration):
        lines = STATUS.read_text().splitlines()
        return int(next(x for x in lines if x.startswith("VmHWM")).split()[1]) / 2**20
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (2**30 if sys.platform == "darwin" else 2**20)
