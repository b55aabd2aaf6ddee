"""Several actions at once, each in its own process with one thread; or one after the other."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar
from unittest.mock import patch

from imocap_core.errors import WorkFailed
from imocap_core.executors.processes import THREADS, worker_processes
from imocap_core.executors.tasks import Report, Serial, Task, perform
from imocap_core.pipeline.runner import Display, Outcome

Result = TypeVar("Result")


class LineDisplay:
    """The display of a worker process: one line for each stage that it makes."""

    def __init__(self) -> None:
        self._why = ""

    def started(self, stage: str, why: list[str]) -> None:
        """Remember the reason."""
        self._why = why[0] if why else ""

    def progress(self, share: float, what: str) -> None:
        """Nothing: several processes share the terminal."""

    def finished(self, outcome: Outcome) -> None:
        """Write one line with a single call, so that lines of several processes do not mix."""
        line = f"{outcome.stage:<14} {outcome.how} {outcome.seconds:6.1f} s  {self._why}\n"
        os.write(1, line.encode())

    def made_demo(self, name: str, folder: Path) -> None:
        """Nothing."""

    def waiting(self) -> None:
        """Nothing."""

    def notice(self, sentence: str) -> None:
        """Nothing."""


@dataclass
class ForwardingDisplay:
    """A display that passes on what it is told; others add to it."""

    display: Display

    def started(self, stage: str, why: list[str]) -> None:
        """Passed on."""
        self.display.started(stage, why)

    def progress(self, share: float, what: str) -> None:
        """Passed on."""
        self.display.progress(share, what)

    def finished(self, outcome: Outcome) -> None:
        """Passed on."""
        self.display.finished(outcome)

    def made_demo(self, name: str, folder: Path) -> None:
        """Passed on."""
        self.display.made_demo(name, folder)

    def waiting(self) -> None:
        """Passed on."""
        self.display.waiting()

    def notice(self, sentence: str) -> None:
        """Passed on."""
        self.display.notice(sentence)


@dataclass
class ActionDisplay(ForwardingDisplay):
    """A display that names the action (and variant) of each stage, and leaves out cached stages."""

    name: str

    def started(self, stage: str, why: list[str]) -> None:
        """The name goes before the first reason."""
        first, *others = why or [""]
        self.display.started(stage, [f"{self.name}: {first}", *others])

    def finished(self, outcome: Outcome) -> None:
        """Passed on for what was made."""
        if outcome.how == "made":
            self.display.finished(outcome)


@dataclass(frozen=True)
class JobEnd(Generic[Result]):
    """How a job of a benchmark ended: its result, or None and a sentence why."""

    name: str
    result: Result | None
    fault: str
    seconds: float


def each(
    work: Callable[..., Result],
    tasks: Sequence[tuple[str, tuple[Any, ...]]],
    jobs: int,
    display: Display,
) -> Iterator[JobEnd[Result]]:
    """Call ``work(display, *arguments)`` for every task (name, arguments), as they end.

    With several jobs, `work` must be a module's function, and its arguments and result must pickle.
    A task that fails does not stop the others; an interrupt by the user does.
    """
    alone = jobs == 1 or len(tasks) < 2
    shown = display if alone else LineDisplay()
    graph = [Task(name, _with_display, (work, shown, given)) for name, given in tasks]
    with nullcontext(Serial()) if alone else worker_processes(jobs, fresh=True) as executor:
        for end in perform(graph, executor):
            yield JobEnd(end.task.name, end.result, end.fault, end.seconds)


def _with_display(
    report: Report, work: Callable[..., Result], display: Display, arguments: tuple[Any, ...]
) -> Result:
    return work(display, *arguments)


def other_thread_count() -> int:
    """A number of threads that this process's linear algebra does not have."""
    return 2 if os.environ.get(THREADS[0]) == "1" else 1


def in_process(work: Callable[..., Result], arguments: tuple[Any, ...], threads: int) -> Result:
    """`work(*arguments)` in a process of its own, whose linear algebra has `threads` threads."""
    context = multiprocessing.get_context("spawn")
    with (
        patch.dict(os.environ, dict.fromkeys(THREADS, str(threads))),
        ProcessPoolExecutor(1, mp_context=context) as pool,
    ):
        try:
            return pool.submit(work, *arguments).result()
        except BrokenProcessPool:
            raise WorkFailed("its process died (out of memory?)") from None


def was_interrupted(error: WorkFailed) -> bool:
    """Whether the user interrupted the work: then no other task may begin."""
    return isinstance(error.__context__, KeyboardInterrupt)
