"""Tasks on a Dask cluster: one of this machine, or any scheduler by its address.

The scheduler gives a task whose worker died to another one, and gives up on a task that has ended
several workers (`distributed.scheduler.allowed-failures`).
"""

from __future__ import annotations

import importlib.util
import logging
import os
import queue
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

from imocap_core.errors import WorkFailed
from imocap_core.executors.attempt import attempt
from imocap_core.executors.task import Begun, Ended, Event, Progressed, Task, Watch
from imocap_core.workers import python_command, take_share

if TYPE_CHECKING:
    from distributed import Client, Future

TOPIC = "imocap"
AHEAD = 2  # tasks submitted for every thread of the cluster: workers never wait for this process
CONNECT_S = 20
WORKERS = "from distributed.cli.dask_worker import main; main()"
WORKER_SETTINGS = {
    "DASK_DISTRIBUTED__WORKER__DAEMON": "False",
    "DASK_LOGGING__DISTRIBUTED": "error",
}
MISSING = "the executor dask needs Dask's distributed: pip install 'imocap[dask]'"


class Cluster:
    """An executor on a Dask cluster; made by `dask_cluster`."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._futures: dict[str, Future] = {}
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._tasks: dict[str, Task] = {}
        self._count = 0
        client.subscribe_topic(TOPIC, self._heard)

    def is_free(self) -> bool:
        """Whether the cluster has few tasks waiting."""
        threads = sum(self._client.nthreads().values())
        return len(self._futures) < AHEAD * max(threads, 1)

    def submit(self, task: Task) -> None:
        """Hand a task to the scheduler."""
        self._count += 1
        self._tasks[task.name] = task
        future = self._client.submit(
            _on_worker,
            task,
            key=f"{task.name} #{self._count}",
            priority=-task.priority,
            pure=False,
        )
        self._futures[task.name] = future
        future.add_done_callback(lambda future: self._events.put(_end_of(task, future)))

    def wait(self, watch: Watch) -> Ended:
        """Wait until an attempt ends."""
        while not isinstance(event := self._events.get(), Ended):
            watch(event)
        del self._futures[event.task.name]
        return event

    def close(self) -> None:
        """Cancel what has not ended."""
        self._client.unsubscribe_topic(TOPIC)
        self._client.cancel(list(self._futures.values()))

    def _heard(self, event: tuple[float, Any]) -> None:
        """What a worker logged."""
        name, *rest = event[1]
        task = self._tasks.get(name)
        if task is None or name not in self._futures:
            return
        if len(rest) == 1:
            self._events.put(Begun(task, str(rest[0])))
        else:
            self._events.put(Progressed(task, float(rest[0]), str(rest[1])))


@contextmanager
def dask_cluster(
    workers: int,
    address: str | None = None,
    *,
    memory_bytes: int | None = None,
    announce: Callable[[str], None] = lambda text: None,
) -> Iterator[Cluster]:
    """An executor on a Dask cluster.

    Args:
        workers: processes of a cluster on this machine, each with one thread.
        address: of a scheduler, instead of a cluster on this machine.
        memory_bytes: largest memory of a worker of a cluster on this machine.
        announce: called with the address of the dashboard, where bokeh is installed.

    WorkFailed where distributed is not installed or the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError:
        raise WorkFailed(MISSING) from None
    has_dashboard = importlib.util.find_spec("bokeh") is not None
    local = _local_cluster(workers, memory_bytes) if address is None else nullcontext(address)
    with local as address:
        try:
            client = Client(address, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            raise WorkFailed(
                f"no Dask scheduler answers at {address}: {error}; start one with `dask scheduler`"
            ) from None
        if has_dashboard:
            announce(f"Dask's dashboard: {client.dashboard_link}")
        executor = Cluster(client)
        try:
            yield executor
        finally:
            executor.close()
            client.close()


@contextmanager
def _local_cluster(workers: int, memory_bytes: int | None) -> Iterator[str]:
    """Address of a scheduler in this process, with workers of a Python that never imports this
    process's main module, as `LocalCluster`'s would."""
    from distributed import LocalCluster

    options = [f"--nworkers={workers}", "--nthreads=1", "--no-dashboard", "--death-timeout=30"]
    options.append(f"--memory-limit={memory_bytes or 0}")
    with LocalCluster(
        n_workers=0,
        processes=False,
        dashboard_address="127.0.0.1:0",
        protocol="tcp://",
        host="127.0.0.1",
        silence_logs=logging.ERROR,
    ) as cluster:
        address = str(cluster.scheduler_address)
        process = subprocess.Popen(
            python_command(WORKERS, address, *options), env=os.environ | WORKER_SETTINGS
        )
        try:
            yield address
        finally:
            process.terminate()
            process.wait()


def _on_worker(task: Task) -> Ended:
    """One attempt, on one thread of a worker of the cluster, which others work beside."""
    from distributed import get_worker

    take_share(1)
    worker = get_worker()
    worker.log_event(TOPIC, (task.name, str(worker.name)))
    return attempt(
        task, lambda share, text: worker.log_event(TOPIC, (task.name, round(share, 3), text))
    )


def _end_of(task: Task, future: Future) -> Ended:
    """How a task that the scheduler has ended came out."""
    if future.status == "finished":
        ended: Ended = future.result()
        return ended
    cause = future.exception() if future.status == "error" else None
    if type(cause).__name__ == "KilledWorker":
        return Ended(task, 0.0, None, f"its workers died one after another: {cause}")
    return Ended(task, 0.0, None, f"the cluster gave it up: {cause or future.status}", lost=True)
