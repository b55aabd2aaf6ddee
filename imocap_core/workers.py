"""Work done in turn or on threads; what comes out is the same either way."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

Each = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]  # map


def in_turn(work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """One after the other."""
    return [work(item) for item in items]


def on(pool: Executor) -> Each:
    """At the same time, on a pool's threads."""
    return lambda work, items: list(pool.map(work, items))


def cores() -> int:
    """How many this process may use; systems that do not say let it use all."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def at_once(work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """At the same time, as many as there are cores."""
    workers = max(1, min(len(items), cores()))
    with ThreadPoolExecutor(workers) as pool:
        return on(pool)(work, items)
