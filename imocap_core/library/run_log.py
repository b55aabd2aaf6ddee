"""The record of an action's last run for programs: artifacts/ACTION/run.json.

It has what artifacts must not have, because the same input gives the same bytes there: the clock,
the machine, and what was said to the user. A run that fails leaves a record too, with its error.
"""

from __future__ import annotations

import json
import platform
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

from imocap_core.artifacts.file_memory import save_memory
from imocap_core.errors import ImocapError, Stopped
from imocap_core.library.memory_notice import available_bytes, frames_of, memory_notice
from imocap_core.library.status import left_out_notes
from imocap_core.pipeline.runner import Display, Job, Outcome
from imocap_core.verdict.findings import Verdict
from imocap_core.version import __version__
from imocap_core.whole_files import write_whole

FILE = "run.json"
LARGE = ("initial_smpl", "sync", "smpl_ba", "refine_sync", "uncertainty")  # stages, in memory
FORMAT = 1  # rises when a field changes its meaning or goes
LIBRARIES = ("numpy", "scipy", "torch", "opencv-python-headless", "av", "mcap", "pydantic")


@dataclass
class RunLog:
    """What is known of a run while it goes on."""

    job: Job
    began: datetime = field(default_factory=lambda: datetime.now(UTC))
    outcomes: list[Outcome] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    verdict: Verdict | None = None
    library_warnings: list[str] = field(default_factory=list)

    def document(self, error: str | None) -> dict[str, Any]:
        """As plain data; error: the sentence that ended the run, or None."""
        ended = datetime.now(UTC)
        settings, verdict = self.job.settings, self.verdict
        stored = {outcome.stage: outcome.stored for outcome in self.outcomes}
        sentences = left_out_notes(stored)
        if verdict is not None:
            sentences = [finding.sentence for finding in verdict.findings]
        return {
            "format": FORMAT,
            "action": self.job.action.name,
            "began": self.began.isoformat(timespec="seconds"),
            "seconds": round((ended - self.began).total_seconds(), 3),
            "status": "done" if error is None else "failed",
            "error": error,
            "stages": [_of_outcome(outcome) for outcome in self.outcomes],
            "summary": [] if verdict is None else list(verdict.summary),
            "warnings": [*self.notes, *sentences, *self.library_warnings],
            "seed": settings.seed,
            "params": asdict(settings.params),
            "versions": versions(),
            "machine": f"{platform.system()} {platform.machine()}",
            "device": self.job.device,
        }


def _of_outcome(outcome: Outcome) -> Mapping[str, Any]:
    return {
        "stage": outcome.stage,
        "how": outcome.how,
        "seconds": round(outcome.seconds, 3),
        "peak_bytes": outcome.peak_bytes,
        "key": outcome.stored.key,
        "digest": outcome.stored.digest,
    }


def versions() -> dict[str, str]:
    """Of the program, of Python, and of the libraries that results depend on."""
    by_name = {"imocap": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        with suppress(metadata.PackageNotFoundError):
            by_name[name] = metadata.version(name)
    return by_name


class LoggedDisplay:
    """A `Display` that also notes which stages have ended, and says when memory may not suffice."""

    def __init__(self, display: Display, log: RunLog) -> None:
        self._log, self._memory_known = log, False
        self.progress, self.notice = display.progress, display.notice
        self.made_demo, self.waiting = display.made_demo, display.waiting
        self._started, self._finished = display.started, display.finished

    def started(self, stage: str, why: list[str]) -> None:
        """A stage begins; before the first that needs much memory, what it is expected to need."""
        self._started(stage, why)
        stored = {outcome.stage: outcome.stored for outcome in self._log.outcomes}
        if self._memory_known or stage not in LARGE or "keypoints" not in stored:
            return
        self._memory_known = True
        if sentence := memory_notice(frames_of(stored["keypoints"]), available_bytes()):
            self._log.notes.append(sentence)
            self.notice(sentence)

    def finished(self, outcome: Outcome) -> None:
        """A stage has its artifact."""
        self._log.outcomes.append(outcome)
        self._finished(outcome)


@contextmanager
def recording(job: Job, notes: Sequence[str]) -> Iterator[RunLog]:
    """A log that is written when the body ends, however it ends."""
    log = RunLog(job, notes=list(notes))
    error: str | None = None
    show = warnings.showwarning
    warnings.showwarning = _also_into(log.library_warnings, show)
    try:
        yield log
    except (ImocapError, Stopped) as ended:
        error = str(ended)
        raise
    finally:
        warnings.showwarning = show
        with suppress(OSError):  # a store on a disk that can only be read
            text = json.dumps(log.document(error), indent=1, ensure_ascii=False, default=str)
            write_whole(job.store.folder / job.action.name / FILE, text + "\n")
        save_memory(job.store.folder)


def _also_into(texts: list[str], show: Callable[..., Any]) -> Callable[..., Any]:
    def shown(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        texts.append(f"{category.__name__}: {message}")
        show(message, category, *place, **more)

    return shown
