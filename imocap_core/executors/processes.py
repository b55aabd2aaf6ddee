"""Tasks in processes of their own on this machine; a process that dies is replaced.

Every worker is a fresh process (spawn) with one thread of linear algebra and its share of the
cores, joined to this one by a pipe. Where the pipe closes before the task has ended, the process
has died: the kernel ends the largest one when memory runs out.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from imocap_core.errors import system_fault
from imocap_core.executors.attempt import attempt
from imocap_core.executors.task import Begun, Ended, Event, Progressed, Task, Watch
from imocap_core.memory_limit import limit_memory
from imocap_core.workers import SAFE_PATH, cores, end_with_parent_only, environment, take_share

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
KILL = 9


@dataclass(frozen=True)
class WorkerSettings:
    """How worker processes are started.

    cores: that one may use. memory_bytes: the largest memory of one, None for no limit. fresh: each
    task gets one of its own. outer_safe_path: this process's PYTHONSAFEPATH.
    """

    cores: int
    memory_bytes: int | None
    fresh: bool
    outer_safe_path: str | None


class Processes:
    """An executor with a number of worker processes; made by `worker_processes`."""

    def __init__(self, workers: int, settings: WorkerSettings) -> None:
        self._workers, self._busy, self._settings = workers, 0, settings
        self._tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._alive: dict[str, BaseProcess] = {}
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
        for process in list(self._alive.values()):
            process.terminate()

    def _lane(self, name: str) -> None:
        """One worker process, replaced when it has died or every task gets a fresh one."""
        pipe: Connection | None = None
        while (task := self._tasks.get()) is not None and not self._closed:
            try:
                pipe = pipe or self._start(name)
            except OSError as error:
                self._events.put(Ended(task, 0.0, None, system_fault(error), lost=True))
                continue
            self._events.put(Begun(task, name))
            ended = self._carry_out(task, pipe)
            if ended is None or self._settings.fresh:
                pipe.close()
                pipe = None
                process = self._alive.pop(name)
                process.join()
                ended = ended or Ended(task, 0.0, None, _cause(process.exitcode), lost=True)
            self._events.put(ended)
        if pipe is not None:
            pipe.close()

    def _start(self, name: str) -> Connection:
        ours, theirs = multiprocessing.Pipe()
        process = multiprocessing.get_context("spawn").Process(
            target=_serve, args=(theirs, self._settings), name=name
        )
        process.start()
        theirs.close()
        self._alive[name] = process
        if self._closed:
            process.terminate()
        return ours

    def _carry_out(self, task: Task, pipe: Connection) -> Ended | None:
        """How the attempt ended; None when the worker died."""
        try:
            pipe.send(task)
            while not isinstance(event := pipe.recv(), Ended):
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
    share = max(1, cores() // workers)
    settings = WorkerSettings(share, memory_bytes, fresh, os.environ.get(SAFE_PATH))
    with environment({SAFE_PATH: "1", **dict.fromkeys(THREADS, "1")}):
        executor = Processes(workers, settings)
        try:
            yield executor
        finally:
            executor.close()


def _serve(pipe: Connection, settings: WorkerSettings) -> None:
    """Carry out what comes through the pipe, until it closes."""
    end_with_parent_only(settings.outer_safe_path)
    take_share(settings.cores)
    if settings.memory_bytes is not None:
        limit_memory(settings.memory_bytes)
    while True:
        try:
            task: Task = pipe.recv()
        except EOFError:
            return
        pipe.send(_attempt(task, pipe))


def _attempt(task: Task, pipe: Connection) -> Ended:
    return attempt(task, lambda share, text: pipe.send(Progressed(task, share, text)))


def _cause(exitcode: int | None) -> str:
    """The sentence about a process that died."""
    if exitcode is None or exitcode >= 0:
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
