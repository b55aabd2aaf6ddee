"""The processes of a detector that are at work at the same time."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Event
from typing import TypeVar

from imocap_core.detect.process import Worker

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass
class WorkerGroup:
    """They can be ended together; one that starts later ends at once."""

    stopped: Event = field(default_factory=Event)
    working: list[Worker] = field(default_factory=list)

    def add(self, worker: Worker) -> None:
        """One has started."""
        self.working.append(worker)
        if self.stopped.is_set():
            worker.kill()

    def results(
        self, call: Callable[[Task], Result], tasks: Iterable[Task], at_once: int
    ) -> list[Result]:
        """A call's results for all tasks, so many at once; the first error, or Ctrl-C, ends all."""
        with ThreadPoolExecutor(at_once) as pool:
            try:
                return list(pool.map(call, tasks))
            except BaseException:
                self.stop()
                raise

    def stop(self) -> None:
        """End all of them."""
        self.stopped.set()
        for worker in self.working:
            worker.kill()
