"""Tasks in processes of their own on this machine; a process that dies is replaced.

Every worker is a fresh Python (`executors.worker`) with one thread of linear algebra and its share
of the cores, joined to this one by its standard input and output. Where its output closes before
the task has ended, the process has died: the kernel ends the largest one when memory runs out.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from imocap_core.errors import system_fault
from imocap_core.executors.task import Begun, Ended, Event, Task, Watch
from imocap_core.executors.worker import PROGRAM, receive, send
from imocap_core.workers import cores, python_command

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
KILL = 9
END_S = 10.0

Process = subprocess.Popen[bytes]


@dataclass(frozen=True)
class WorkerSettings:
    """How worker processes are started.

    cores: that one may use. memory_bytes: the largest memory of one, None for no limit. fresh: each
    task gets one of its own.
    """

    cores: int
    memory_bytes: int | None
    fresh: bool


class Processes:
    """An executor with a number of worker processes; made by `worker_processes`."""

    def __init__(self, workers: int, settings: WorkerSettings) -> None:
        self._workers, self._busy, self._settings = workers, 0, settings
        self._tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._alive: dict[str, Process] = {}
        self._closed = False
        for number in range(workers):
            lane = threading.Thread(target=self._lane, args=(f"worker {number + 1}",), daemon=True)
            lane.start()

    def is_free(self) -> bool:
        """Whether a worker has nothing to do."""
        return self._busy < self._workers

    def submit(self, task: Task) -> None:
        """Give a task to a worker that has nothing to do."""
        self._busy += 1
        self._tasks.put(task)

    def wait(self, watch: Watch) -> Ended:
        """Wait until an attempt ends."""
        while not isinstance(event := self._events.get(), Ended):
            watch(event)
        self._busy -= 1
        return event

    def close(self) -> None:
        """End all workers, whatever they do."""
        self._closed = True
        for _ in range(self._workers):
            self._tasks.put(None)
        alive = list(self._alive.values())
        for process in alive:
            process.terminate()
        for process in alive:  # what they write in ends with them
            with suppress(subprocess.TimeoutExpired):
                process.wait(END_S)

    def _lane(self, name: str) -> None:
        """One worker process, replaced when it has died or every task gets a fresh one."""
        worker: Process | None = None
        while (task := self._tasks.get()) is not None and not self._closed:
            try:
                worker = worker or self._start(name)
            except OSError as error:
                self._events.put(Ended(task, 0.0, None, system_fault(error), lost=True))
                continue
            self._events.put(Begun(task, name))
            ended = self._carry_out(task, worker)
            if ended is None or self._settings.fresh:
                _leave(worker)
                del self._alive[name]
                ended = ended or Ended(task, 0.0, None, _cause(worker.wait()), lost=True)
                worker = None
            self._events.put(ended)
        if worker is not None:
            _leave(worker)

    def _start(self, name: str) -> Process:
        settings = self._settings
        process = subprocess.Popen(
            python_command(PROGRAM, str(settings.cores), str(settings.memory_bytes or "")),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | dict.fromkeys(THREADS, "1"),
        )
        self._alive[name] = process
        if self._closed:
            process.terminate()
        return process

    def _carry_out(self, task: Task, worker: Process) -> Ended | None:
        """How the attempt ended; None when the worker died."""
        assert worker.stdin is not None
        assert worker.stdout is not None
        try:
            send(task, worker.stdin)
            while not isinstance(event := pickle.loads(receive(worker.stdout)), Ended):
                self._events.put(event)
        except (EOFError, OSError):
            return None
        return event


@contextmanager
def worker_processes(
    workers: int, *, memory_bytes: int | None = None, fresh: bool = False
) -> Iterator[Processes]:
    """An executor with worker processes, which end with the body.

    Args:
        memory_bytes: largest memory of one worker; None for no limit.
        fresh: every task gets a process of its own.
    """
    executor = Processes(workers, WorkerSettings(max(1, cores() // workers), memory_bytes, fresh))
    try:
        yield executor
    finally:
        executor.close()


def _leave(worker: Process) -> None:
    """Close the pipes to a worker, which ends it."""
    for stream in (worker.stdin, worker.stdout):
        assert stream is not None
        with suppress(OSError):
            stream.close()
    with suppress(subprocess.TimeoutExpired):
        worker.wait(END_S)


def _cause(exitcode: int) -> str:
    """The sentence about a process that died."""
    if exitcode >= 0:
        return f"its process ended by itself (exit code {exitcode})"
    try:
        name = signal.Signals(-exitcode).name
    except ValueError:
        name = f"signal {-exitcode}"
    why = ", as the system does when memory runs out" if -exitcode == KILL else ""
    return (
        f"its process was ended from outside ({name}{why}); use fewer workers, or a machine "
        "with more memory"
    )
