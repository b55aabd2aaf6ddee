"""Tasks in this process, one after the other."""

from __future__ import annotations

from imocap_core.executors.attempt import attempt
from imocap_core.executors.task import Begun, Ended, Progressed, Task, Watch

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
