"""Several actions at once, each in a process of its own with one thread; or one after the other."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Display, Outcome

Made = TypeVar("Made")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Quiet:
    """The display of a process of its own: a line when something of its action is made."""

    def __init__(self) -> None:
        self._why = ""

    def started(self, stage: str, why: list[str]) -> None:
        """Remember what is at work."""
        self._why = why[0] if why else ""

    def progress(self, share: float, what: str) -> None:
        """Nothing: several processes share the terminal."""

    def finished(self, outcome: Outcome) -> None:
        """One line, written at once, whatever the others write."""
        said = f"{outcome.stage:<14} {outcome.how} {outcome.seconds:6.1f} s  {self._why}\n"
        os.write(1, said.encode())

    def made_demo(self, name: str, folder: Path) -> None:
        """Nothing."""

    def waiting(self) -> None:
        """Nothing."""


@dataclass(frozen=True)
class Named:
    """Tells a display which action (and variant) it is that is at work, and leaves out what is
    cached."""

    display: Display
    name: str

    def started(self, stage: str, why: list[str]) -> None:
        """With the name first."""
        first, *others = why or [""]
        self.display.started(stage, [f"{self.name}: {first}", *others])

    def progress(self, share: float, what: str) -> None:
        """As it is."""
        self.display.progress(share, what)

    def finished(self, outcome: Outcome) -> None:
        """What was made."""
        if outcome.how == "made":
            self.display.finished(outcome)

    def made_demo(self, name: str, folder: Path) -> None:
        """As it is."""
        self.display.made_demo(name, folder)

    def waiting(self) -> None:
        """As it is."""
        self.display.waiting()


@dataclass(frozen=True)
class Ended(Generic[Made]):
    """How a task ended: what it made, or the sentence why not."""

    name: str
    made: Made | None
    fault: str
    seconds: float


def each(
    work: Callable[..., Made],
    tasks: Sequence[tuple[str, tuple[Any, ...]]],
    jobs: int,
    display: Display,
) -> Iterator[Ended[Made]]:
    """Call ``work(display, *arguments)`` for every task (name, arguments), as they end.

    With several jobs `work` must be a module's function and everything it takes and gives must
    pickle. A task that fails does not stop the others; the user does.
    """
    if jobs == 1 or len(tasks) < 2:
        for name, arguments in tasks:
            yield _ended(name, work, display, arguments)
        return
    context = multiprocessing.get_context("spawn")
    with (
        _single_threads(),
        ProcessPoolExecutor(jobs, mp_context=context, max_tasks_per_child=1) as pool,
    ):
        waiting: dict[Future[Ended[Made]], str] = {
            pool.submit(_ended, name, work, Quiet(), arguments): name for name, arguments in tasks
        }
        try:
            for future in as_completed(waiting):
                yield _result(future, waiting[future])
        finally:
            pool.shutdown(cancel_futures=True)


def _ended(
    name: str, work: Callable[..., Made], display: Display, arguments: tuple[Any, ...]
) -> Ended[Made]:
    began = time.perf_counter()
    try:
        made = work(display, *arguments)
    except WorkFailed as error:
        if was_stopped(error):
            raise
        return Ended(name, None, str(error), time.perf_counter() - began)
    return Ended(name, made, "", time.perf_counter() - began)


def was_stopped(error: WorkFailed) -> bool:
    """Whether it was the user who ended the work: then nothing else shall begin."""
    return isinstance(error.__context__, KeyboardInterrupt)


def _result(future: Future[Ended[Made]], name: str) -> Ended[Made]:
    try:
        return future.result()
    except BrokenProcessPool:
        return Ended(name, None, "its process died (out of memory?); try fewer --jobs", 0.0)


@contextmanager
def _single_threads() -> Iterator[None]:
    """Processes begun meanwhile compute with one thread."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
