"""The program of a worker process: tasks come in by its standard input, events leave by its
standard output, both pickled twice, so that a task is imported by the thread that carries it out.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import sys
import threading
from contextlib import suppress
from typing import IO, Any

from imocap_core.executors.attempt import attempt
from imocap_core.executors.task import Ended, Progressed, Task
from imocap_core.memory_limit import limit_memory
from imocap_core.workers import take_share

PROGRAM = "from imocap_core.executors.worker import main; main()"


def send(message: Any, stream: IO[bytes]) -> None:
    """Write a task or an event."""
    pickle.dump(pickle.dumps(message), stream)
    stream.flush()


def receive(stream: IO[bytes]) -> bytes:
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
    cores, memory_bytes = sys.argv[1:]
    events = os.fdopen(os.dup(1), "wb")
    with suppress(OSError):
        os.dup2(2, 1)
    take_share(int(cores))
    if memory_bytes:
        limit_memory(int(memory_bytes))
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
            message = receive(sys.stdin.buffer)
        except EOFError:
            if busy.is_set():
                os._exit(1)
            tasks.put(None)
            return
        busy.set()
        tasks.put(message)
