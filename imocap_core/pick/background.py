"""Work that goes on while the page is used: one thread a queue, ended with the server."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from queue import Empty, Queue
from threading import Event, Lock, Thread

END_S = 5.0


class BackgroundThread:
    """Runs jobs one after the other; a job that waits already is not queued again."""

    def __init__(self, name: str) -> None:
        self.stopping = Event()
        self._jobs: Queue[tuple[Hashable, Callable[[], None]]] = Queue()
        self._waiting: set[Hashable] = set()
        self._lock = Lock()
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def add(self, key: Hashable, job: Callable[[], None]) -> None:
        """Queue a job, unless one of that key waits. Jobs handle their own errors."""
        with self._lock:
            if key in self._waiting or self.stopping.is_set():
                return
            self._waiting.add(key)
        self._jobs.put((key, job))

    def close(self) -> None:
        """End after the present job; long jobs look at `stopping`."""
        self.stopping.set()
        self._thread.join(END_S)

    def _run(self) -> None:
        while not self.stopping.is_set():
            try:
                key, job = self._jobs.get(timeout=0.1)
            except Empty:
                continue
            with self._lock:
                self._waiting.discard(key)
            job()
