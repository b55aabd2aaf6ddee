"""Graphs of tasks, carried out in order: attempts, retries, and what a failure stops."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter
from heapq import heappop, heappush
from typing import Any, Literal, Protocol, runtime_checkable

from imocap_core.errors import ImocapError, program_fault, system_fault

Report = Callable[[float, str], None]
"""Called by a task with the share of its work that is done (0 to 1), and what it is doing."""


@dataclass(frozen=True)
class Task:
    """One node of a directed acyclic graph.

    name: unique in the graph. work: a module's function, called as ``work(report, *arguments)``;
    arguments and result must pickle. after: names of the tasks that must have succeeded before.
    priority: of the tasks that may begin, the one with the smallest number does.
    """

    name: str
    work: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    after: tuple[str, ...] = ()
    priority: int = 0


@dataclass(frozen=True)
class TaskEnd:
    """How a task ended.

    fault: a sentence why it has no result. skipped: a task that it comes after did not succeed.
    seconds: of the last attempt.
    """

    task: Task
    state: Literal["done", "failed", "skipped"]
    result: Any = None
    fault: str = ""
    seconds: float = 0.0
    attempts: int = 0


@dataclass(frozen=True)
class Begun:
    """A worker has begun an attempt at a task."""

    task: Task
    worker: str


@dataclass(frozen=True)
class Progressed:
    """An attempt at a task has done this share of its work."""

    task: Task
    share: float
    text: str


@dataclass(frozen=True)
class Ended:
    """An attempt at a task has ended.

    fault: why it has no result, or empty. lost: its worker died, or ran out of memory: the same
    task may succeed at another time or place.
    """

    task: Task
    seconds: float
    result: Any = None
    fault: str = ""
    lost: bool = False


Event = Begun | Progressed | Ended
Watch = Callable[[Begun | Progressed], None]


@runtime_checkable
class Executor(Protocol):
    """Carries out attempts at tasks."""

    def is_free(self) -> bool:
        """Whether another task may be submitted."""

    def submit(self, task: Task) -> None:
        """Begin an attempt, now or as soon as a worker has time."""

    def wait(self, watch: Watch) -> Ended:
        """Wait until an attempt ends; `watch` is called with what happens meanwhile."""


def attempt(task: Task, report: Report) -> Ended:
    """Carry out a task; every error becomes a sentence.

    An interrupt by the user (Ctrl-C, SIGTERM) is none of the task's, and is raised.
    """
    began = time.perf_counter()

    def ended(fault: str, lost: bool = False) -> Ended:
        return Ended(task, time.perf_counter() - began, None, fault, lost)

    try:
        result = task.work(report, *task.arguments)
    except ImocapError as error:
        if isinstance(error.__context__, KeyboardInterrupt):
            raise
        return ended(str(error), _is_passing(error))
    except (OSError, MemoryError) as error:
        return ended(system_fault(error), _is_passing(error))
    except Exception as error:
        return ended(program_fault(error))
    return Ended(task, time.perf_counter() - began, result)


def _is_passing(error: BaseException) -> bool:
    """Whether an error may not come again: memory that others use now, a store that is not
    reachable for a moment."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, (MemoryError, ConnectionError, TimeoutError)):
            return True
        cause = cause.__cause__
    return False


WORKER = "this process"


class Serial:
    """An executor without workers."""

    def __init__(self) -> None:
        self._task: Task | None = None

    def is_free(self) -> bool:
        """One task at a time."""
        return self._task is None

    def submit(self, task: Task) -> None:
        """The task that `wait` carries out."""
        self._task = task

    def wait(self, watch: Watch) -> Ended:
        """Carry out the task that was submitted."""
        task, self._task = self._task, None
        assert task is not None
        watch(Begun(task, WORKER))
        return attempt(task, lambda share, text: watch(Progressed(task, share, text)))


def perform(
    tasks: Sequence[Task],
    executor: Executor,
    watch: Watch = lambda event: None,
    *,
    retries: int = 0,
) -> Iterator[TaskEnd]:
    """Carry out tasks, each after those it names; yields every task as it ends.

    A task that fails stops those after it (they end as skipped) and no others. One whose worker
    died is tried again, up to `retries` times; a fault of its own is final.

    Args:
        tasks: of a directed acyclic graph. Of those that may begin, the first of the smallest
            priority does.
        watch: called with what begins and with progress.
    """
    places = {task.name: (task.priority, n, task) for n, task in enumerate(tasks)}
    graph = TopologicalSorter({task.name: task.after for task in tasks})
    graph.prepare()
    ready: list[tuple[int, int, Task]] = []  # priority, place among the tasks, the task
    attempts: Counter[str] = Counter()
    failed: dict[str, str] = {}  # by task, which one failed: this one, or one that it comes after
    while True:
        while names := graph.get_ready():
            for name in names:
                *_, task = places[name]
                causes = [failed[other] for other in task.after if other in failed]
                if not causes:
                    heappush(ready, places[name])
                    continue
                failed[name] = causes[0]
                graph.done(name)
                yield TaskEnd(task, "skipped", None, f"{causes[0]} failed")
        if not graph.is_active():
            return
        while ready and executor.is_free():
            executor.submit(heappop(ready)[-1])
        event = executor.wait(watch)
        name = event.task.name
        attempts[name] += 1
        if event.lost and attempts[name] <= retries:
            heappush(ready, places[name])
            continue
        state: Literal["done", "failed"] = "done"
        fault = event.fault
        if fault:
            state, failed[name] = "failed", name
            fault += f" (tried {attempts[name]} times)" if attempts[name] > 1 else ""
        graph.done(name)
        yield TaskEnd(places[name][-1], state, event.result, fault, event.seconds, attempts[name])
