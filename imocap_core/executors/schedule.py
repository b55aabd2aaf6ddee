"""Which task of a graph comes next."""

from __future__ import annotations

import heapq
from collections.abc import Sequence

from imocap_core.executors.task import Task


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
