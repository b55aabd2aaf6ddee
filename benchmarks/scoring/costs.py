"""What each stage's artifact cost when it was made, kept so that a cached run still tells it.

Measured in this process; a figure is of the machine and the load at that time.
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

from imocap_core.pipeline.runner import Display, Outcome

STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Cost:
    """Wall time and the most memory the process held meanwhile."""

    seconds: float
    peak_gb: float


@dataclass
class Meter:
    """A display that also writes down what each stage cost; `folder` keeps the figures."""

    display: Display
    folder: Path
    _began: float = field(default=0.0, init=False)

    def started(self, stage: str, why: list[str]) -> None:
        reset_peak()
        self._began = time.perf_counter()
        self.display.started(stage, why)

    def progress(self, share: float, what: str) -> None:
        self.display.progress(share, what)

    def finished(self, outcome: Outcome) -> None:
        if outcome.how == "made":
            self.keep(outcome.stored.key, Cost(time.perf_counter() - self._began, peak_gb()))
        self.display.finished(outcome)

    def made_demo(self, name: str, folder: Path) -> None:
        self.display.made_demo(name, folder)

    def waiting(self) -> None:
        self.display.waiting()

    @contextmanager
    def measuring(self, name: str, found: dict[str, Cost]) -> Iterator[None]:
        """Add to `found` what the body costs."""
        reset_peak()
        began = time.perf_counter()
        yield
        found[name] = Cost(time.perf_counter() - began, peak_gb())

    def keep(self, key: str, cost: Cost) -> None:
        """Write down what the artifact of a stage key cost."""
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / key).write_text(json.dumps([cost.seconds, cost.peak_gb]))

    def costs(self, outcomes: Sequence[Outcome]) -> dict[str, Cost]:
        """Stage -> cost, of those that were measured when they were made."""
        found = {}
        for outcome in outcomes:
            with suppress(OSError, ValueError, TypeError):
                written = (self.folder / outcome.stored.key).read_text()
                found[outcome.stage] = Cost(*json.loads(written))
        return found


def reset_peak() -> None:
    """Forget the most memory held so far, where the system can."""
    with suppress(OSError):
        CLEAR.write_text("5")


def peak_gb() -> float:
    """Most memory held since `reset_peak`, or since the process began where that can't be reset."""
    with suppress(OSError, StopIteration):
        lines = STATUS.read_text().splitlines()
        return int(next(x for x in lines if x.startswith("VmHWM")).split()[1]) / 2**20
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (2**30 if sys.platform == "darwin" else 2**20)
