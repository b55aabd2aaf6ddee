"""Map functions that run in sequence or on threads; the results are the same."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

Each = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]  # map


def in_turn(work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """Map in sequence."""
    return [work(item) for item in items]


def on(pool: Executor) -> Each:
    """Map on the threads of a pool."""
    return lambda work, items: list(pool.map(work, items))


def cores() -> int:
    """Number of processor cores that this process may use; where unknown, of all cores."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def at_once(work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """Map on as many threads as there are cores."""
    workers = max(1, min(len(items), cores()))
    with ThreadPoolExecutor(workers) as pool:
        return on(pool)(work, items)
