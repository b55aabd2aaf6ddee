"""Serial and threaded maps with equal results, compiled loops, and the command line of a worker."""

from __future__ import annotations

import inspect
import multiprocessing.spawn
import os
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from typing import Any

MapFn = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]  # map

_of_thread = threading.local()  # cores: a worker's share of them


def compiled(loop: Callable[..., Any]) -> Callable[..., Any]:
    """Compiled by Numba at its first call and kept beside the source; runs without Python's lock.
    A loop has no annotations, which the tests check at run time."""
    import numba  # takes half a second

    make = partial(numba.njit, nogil=True, error_model="numpy")
    try:
        return make(cache=True)(inspect.unwrap(loop))
    except RuntimeError:  # no folder for it can be written
        return make()(inspect.unwrap(loop))


def serial_map(work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """Map in sequence."""
    return [work(item) for item in items]


def on(pool: Executor) -> MapFn:
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


def thread_map(
    work: Callable[[Any], Any], items: Sequence[Any], most: int | None = None
) -> list[Any]:
    """Map on as many threads as there are cores, or `most` where that is fewer."""
    workers = max(1, min(len(items), cores() if most is None else min(cores(), most)))
    if workers == 1:
        return serial_map(work, items)
    share = max(1, cores() // workers)
    with ThreadPoolExecutor(workers, initializer=take_share, initargs=(share,)) as pool:
        return on(pool)(work, items)


def take_share(share: int) -> None:
    """From now on this thread, being one of several workers, uses so many cores."""
    _of_thread.cores = share


def python_command(program: str, *arguments: str) -> list[str]:
    """Command line of a new Python that runs `program`, with this process's import path.

    Unlike multiprocessing's, the new process never imports the caller's main module: a script needs
    no `if __name__ == "__main__"`. -P: nothing is imported from the working folder, unless this
    process does so too.
    """
    path = [folder or os.getcwd() for folder in sys.path]
    start = f"import sys; n = {len(path)}; sys.path[:] = sys.argv[1 : n + 1]; "
    start += f"del sys.argv[1 : n + 1]; {program}"
    executable = os.fsdecode(multiprocessing.spawn.get_executable())
    return [executable, "-P", "-c", start, *path, *arguments]
