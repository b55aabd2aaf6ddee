"""Tasks in processes of their own on this machine, or on a Dask cluster.

Tasks in processes of their own on this machine; a process that dies is replaced. Every worker is a
fresh Python (`executors.worker`) with one thread of linear algebra and its share of the cores,
joined to this one by its standard input and output. Where its output closes before the task has
ended, the process has died: the kernel ends the largest one when memory runs out.

The scheduler gives a task whose worker died to another one, and gives up on a task that has ended
several workers (`distributed.scheduler.allowed-failures`).
"""

from __future__ import annotations

import importlib.util
import logging
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import IO, TYPE_CHECKING, Any

from imocap_core.errors import WorkFailed, system_fault
from imocap_core.executors.tasks import Begun, Ended, Event, Progressed, Task, Watch, attempt
from imocap_core.workers import cores, python_command, take_share

if TYPE_CHECKING:
    from distributed import Client, Future


THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
KILL = 9
END_S = 10.0

Process = subprocess.Popen[bytes]


class Processes:
    """An executor with a number of worker processes; made by `worker_processes`.

    fresh: each task gets one of its own.
    """

    def __init__(self, workers: int, fresh: bool) -> None:
        self._workers, self._busy, self._fresh = workers, 0, fresh
        self._share = str(max(1, cores() // workers))  # cores that one may use
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
            if ended is None or self._fresh:
                _leave(worker)
                del self._alive[name]
                ended = ended or Ended(task, 0.0, None, _cause(worker.wait()), lost=True)
                worker = None
            self._events.put(ended)
        if worker is not None:
            _leave(worker)

    def _start(self, name: str) -> Process:
        process = subprocess.Popen(
            python_command(PROGRAM, self._share),
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
            while not isinstance(event := pickle.loads(_receive(worker.stdout)), Ended):
                self._events.put(event)
        except (EOFError, OSError):
            return None
        return event


@contextmanager
def worker_processes(workers: int, *, fresh: bool = False) -> Iterator[Processes]:
    """An executor with worker processes, which end with the body.

    Args:
        fresh: every task gets a process of its own.
    """
    executor = Processes(workers, fresh)
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


PROGRAM = "from imocap_core.executors.processes import main; main()"


def send(message: Any, stream: IO[bytes]) -> None:
    """Write a task or an event."""
    pickle.dump(pickle.dumps(message), stream)
    stream.flush()


def _receive(stream: IO[bytes]) -> bytes:
    """The next message, to be unpickled; EOFError where the other side has ended."""
    try:
        message: bytes = pickle.load(stream)
    except (OSError, pickle.UnpicklingError):
        raise EOFError from None
    return message


def main() -> None:
    """Carry out tasks until the standard input closes: then the process that started this one has
    no more, or has died, and a task at work ends with it.

    Ctrl-C reaches all processes of a terminal; it is the starting one's to heed. What tasks print
    goes to the standard error.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    (cores,) = sys.argv[1:]
    events = os.fdopen(os.dup(1), "wb")
    with suppress(OSError):
        os.dup2(2, 1)
    take_share(int(cores))
    tasks: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    busy = threading.Event()
    threading.Thread(target=_listen, args=(tasks, busy), daemon=True).start()
    while (message := tasks.get()) is not None:
        task: Task = pickle.loads(message)
        ended = _attempt(task, events)
        busy.clear()
        send(ended, events)


def _attempt(task: Task, events: IO[bytes]) -> Ended:
    return attempt(task, lambda share, text: send(Progressed(task, share, text), events))


def _listen(tasks: queue.SimpleQueue[bytes | None], busy: threading.Event) -> None:
    """Pass tasks on; when no more can come, end the loop above, or the process amid a task."""
    while True:
        try:
            message = _receive(sys.stdin.buffer)
        except EOFError:
            if busy.is_set():
                os._exit(1)
            tasks.put(None)
            return
        busy.set()
        tasks.put(message)


TOPIC = "imocap"
AHEAD = 2  # tasks submitted for every thread of the cluster: workers never wait for this process
CONNECT_S = 20
LOOK_S = 5.0  # between two looks whether this machine's workers are still there
START_S = 300  # for a worker of this machine to join, however busy the machine is
ENDED = (
    "the workers of the Dask cluster on this machine have ended: use fewer workers, or run again"
)
WORKERS = "from distributed.cli.dask_worker import main; main()"
WORKER_SETTINGS = {
    "DASK_DISTRIBUTED__WORKER__DAEMON": "False",
    "DASK_LOGGING__DISTRIBUTED": "error",
}
MISSING = "the executor dask needs Dask's distributed: pip install 'imocap[dask]'"


class Cluster:
    """An executor on a Dask cluster; made by `dask_cluster`.

    workers: the process of a cluster on this machine, without which nothing ends; None elsewhere.
    """

    def __init__(self, client: Client, workers: Process | None = None) -> None:
        self._client, self._workers = client, workers
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
            _on_worker, task, key=f"{task.name} #{self._count}", priority=-task.priority, pure=False
        )
        self._futures[task.name] = future
        future.add_done_callback(lambda future: self._events.put(_end_of(task, future)))

    def wait(self, watch: Watch) -> Ended:
        """Wait until an attempt ends; WorkFailed when this machine's workers have all ended."""
        while not isinstance(event := self._next(), Ended):
            watch(event)
        del self._futures[event.task.name]
        return event

    def _next(self) -> Event:
        while True:
            try:
                return self._events.get(timeout=LOOK_S)
            except queue.Empty:
                if self._workers is not None and self._workers.poll() is not None:
                    raise WorkFailed(ENDED) from None

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
    workers: int, address: str | None = None, *, announce: Callable[[str], None] = lambda text: None
) -> Iterator[Cluster]:
    """An executor on a Dask cluster.

    Args:
        workers: processes of a cluster on this machine, each with one thread.
        address: of a scheduler, instead of a cluster on this machine.
        announce: called with the address of the dashboard, where bokeh is installed.

    WorkFailed where distributed is not installed or the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError:
        raise WorkFailed(MISSING) from None
    has_dashboard = importlib.util.find_spec("bokeh") is not None
    there = nullcontext((address, None))
    here = _local_cluster(workers) if address is None else there
    with here as (address, process):
        try:
            client = Client(address, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            raise WorkFailed(
                f"no Dask scheduler answers at {address}: {error}; start one with `dask scheduler`"
            ) from None
        if has_dashboard:
            announce(f"Dask's dashboard: {client.dashboard_link}")
        executor = Cluster(client, process)
        try:
            yield executor
        finally:
            executor.close()
            client.close()


@contextmanager
def _local_cluster(workers: int) -> Iterator[tuple[str, Process]]:
    """Address of a scheduler in this process, and the process of its workers: of a Python that
    never imports this process's main module, as `LocalCluster`'s would."""
    from distributed import LocalCluster

    options = [f"--nworkers={workers}", "--nthreads=1", "--no-dashboard"]
    options += [f"--death-timeout={START_S}", "--memory-limit=0"]
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
            yield address, process
        finally:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(3 * END_S)
            process.kill()
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
