"""The processes of a detector that are at work at the same time."""

from __future__ import annotations

from dataclasses import dataclass, field
from threading import Event

from imocap_core.detect.process import Worker


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

    def stop(self) -> None:
        """End all of them."""
        self.stopped.set()
        for worker in self.working:
            worker.kill()
