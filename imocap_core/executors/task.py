"""A task of a graph, how one attempt at it ended, and how the task ended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

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
