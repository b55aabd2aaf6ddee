"""Graphs of tasks, carried out in order: attempts, retries, and what a failure stops."""

from __future__ import annotations

import heapq
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
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


class Schedule:
    """The tasks of a graph that have not ended.

    ValueError unless every task comes after earlier ones of the list only, which makes the graph
    acyclic.
    """

    def __init__(self, tasks: Sequence[Task]) -> None:
        before: set[str] = set()
        for task in tasks:
            unknown = set(task.after) - before
            if unknown or task.name in before:
                raise ValueError(
                    f"task {task.name}: expected a new name, after earlier tasks only, got "
                    f"{', '.join(sorted(unknown)) or 'a second one of this name'}"
                )
            before.add(task.name)
        self._waiting = {task.name: set(task.after) for task in tasks}
        self._tasks = {task.name: task for task in tasks}
        self._order = {task.name: i for i, task in enumerate(tasks)}
        self._after: dict[str, list[Task]] = {task.name: [] for task in tasks}
        for task in tasks:
            for name in task.after:
                self._after[name].append(task)
        self._ready: list[tuple[int, int, str]] = []
        for task in tasks:
            self._push_if_ready(task)

    def __len__(self) -> int:
        """The number of tasks that have not ended."""
        return len(self._tasks)

    def take(self) -> Task | None:
        """The task to begin now; None when all that remain wait for others."""
        if not self._ready:
            return None
        return self._tasks[heapq.heappop(self._ready)[2]]

    def again(self, task: Task) -> None:
        """Another attempt at a task that was taken."""
        heapq.heappush(self._ready, (task.priority, self._order[task.name], task.name))

    def succeeded(self, task: Task) -> None:
        """Tasks that wait for this one may begin."""
        del self._tasks[task.name]
        for other in self._after[task.name]:
            self._waiting[other.name].discard(task.name)
            if other.name in self._tasks:
                self._push_if_ready(other)

    def failed(self, task: Task) -> list[Task]:
        """The tasks that can never begin now, in their order."""
        del self._tasks[task.name]
        lost: dict[str, Task] = {}
        waiting = list(self._after[task.name])
        while waiting:
            other = waiting.pop()
            if self._tasks.pop(other.name, None) is not None:
                lost[other.name] = other
                waiting += self._after[other.name]
        return sorted(lost.values(), key=lambda t: self._order[t.name])

    def _push_if_ready(self, task: Task) -> None:
        if not self._waiting[task.name]:
            self.again(task)


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
        tasks: of a directed acyclic graph, each listed after those that it comes after.
        watch: called with what begins and with progress.
    """
    schedule = Schedule(tasks)
    attempts: Counter[str] = Counter()
    while len(schedule):
        while executor.is_free() and (task := schedule.take()) is not None:
            executor.submit(task)
        event = executor.wait(watch)
        attempts[event.task.name] += 1
        if event.lost and attempts[event.task.name] <= retries:
            schedule.again(event.task)
        else:
            yield from _ends(schedule, event, attempts[event.task.name])


def _ends(schedule: Schedule, event: Ended, attempts: int) -> Iterator[TaskEnd]:
    task = event.task
    if not event.fault:
        schedule.succeeded(task)
        yield TaskEnd(task, "done", event.result, "", event.seconds, attempts)
        return
    again = f" (tried {attempts} times)" if attempts > 1 else ""
    skipped = schedule.failed(task)
    yield TaskEnd(task, "failed", None, event.fault + again, event.seconds, attempts)
    for other in skipped:
        yield TaskEnd(other, "skipped", None, f"{task.name} failed")
