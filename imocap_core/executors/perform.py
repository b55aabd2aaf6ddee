"""Perform a graph of tasks: order, retries, and what a failure stops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from imocap_core.executors.schedule import Schedule
from imocap_core.executors.task import Ended, Executor, Task, TaskEnd, Watch


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
