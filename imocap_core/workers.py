"""Map functions that run in sequence or on threads; the results are the same. And processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

# multiprocessing starts Python with -c, which imports from the working folder first: somebody
# else's `multiprocessing.py` there would run. With this variable it does not.
SAFE_PATH = "PYTHONSAFEPATH"

Each = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]  # map

_of_thread = threading.local()  # cores: a worker's share of them


def in_turn(work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """Map in sequence."""
    return [work(item) for item in items]


def on(pool: Executor) -> Each:
    """Map on the threads of a pool."""
    return lambda work, items: list(pool.map(work, items))


def cores() -> int:
    """Number of processor cores that this thread may use: its share (`take_share`), else those of
    the process; where unknown, all cores."""
    share: int | None = getattr(_of_thread, "cores", None)
    if share is not None:
        return share
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def at_once(work: Callable[[Any], Any], items: Sequence[Any], most: int | None = None) -> list[Any]:
    """Map on as many threads as there are cores, or `most` where that is fewer."""
    workers = max(1, min(len(items), cores() if most is None else min(cores(), most)))
    if workers == 1:
        return in_turn(work, items)
    share = max(1, cores() // workers)
    with ThreadPoolExecutor(workers, initializer=take_share, initargs=(share,)) as pool:
        return on(pool)(work, items)


def take_share(share: int) -> None:
    """From now on this thread, being one of several workers, uses so many cores."""
    _of_thread.cores = share


@contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of fresh processes, which end at once when the body ends by an error or a signal, or
    this process is killed."""
    before = set(multiprocessing.active_children())
    spawn, safe_path = multiprocessing.get_context("spawn"), os.environ.get(SAFE_PATH)
    with (
        environment({SAFE_PATH: "1"}),
        ProcessPoolExecutor(workers, spawn, end_with_parent_only, (safe_path,)) as pool,
    ):
        try:
            yield pool
        except BaseException:
            for child in set(multiprocessing.active_children()) - before:
                child.terminate()
            raise


def end_with_parent_only(safe_path: str | None) -> None:
    """In a process that was started: ended by its parent only, whose Ctrl-C reaches all of them.

    safe_path: the parent's PYTHONSAFEPATH before it started this process; None where it had none.
    """
    _set(SAFE_PATH, safe_path)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


@contextmanager
def environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Processes started in the body have these variables of the environment."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            _set(name, value)


def _set(name: str, value: str | None) -> None:
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
