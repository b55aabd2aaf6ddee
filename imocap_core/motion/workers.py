"""Work done in turn or on threads; what comes out is the same either way."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Any

Each = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]  # map


def in_turn(work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """One after the other."""
    return [work(item) for item in items]


def on(pool: Executor) -> Each:
    """At the same time, on a pool's threads."""
    return lambda work, items: list(pool.map(work, items))
