"""A generator that runs a few items ahead of its consumer, in a thread."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from queue import Full, Queue
from threading import Event, Thread
from typing import TypeVar

Item = TypeVar("Item")
_POLL_S = 0.1


@dataclass(frozen=True)
class _End:
    """Comes after the last item; the error that ended the iteration, if one did."""

    error: BaseException | None = None


def prefetch(items: Iterable[Item], depth: int = 4) -> Iterator[Item]:
    """The same items in the same order, computed in a thread, at most `depth` of them waiting.

    An error in computing an item is raised here, after the items before it. When the generator is
    closed, the thread ends before its next item. ValueError unless `depth` is at least 1.
    """
    if depth < 1:
        raise ValueError(f"depth: expected at least 1, got {depth}")
    waiting: Queue[Item | _End] = Queue(depth)
    closed = Event()
    producer = Thread(target=_produce, args=(items, waiting, closed), daemon=True)
    producer.start()
    try:
        while not isinstance(item := waiting.get(), _End):
            yield item
        if item.error is not None:
            raise item.error
    finally:
        closed.set()
        producer.join()


def _produce(items: Iterable[Item], waiting: Queue[Item | _End], closed: Event) -> None:
    """Queue items until there are no more, one fails, or the consumer has closed; then the end."""
    end = _End()
    try:
        for item in items:
            _offer(item, waiting, closed)
            if closed.is_set():
                return
    except BaseException as error:
        end = _End(error)
    _offer(end, waiting, closed)


def _offer(item: Item | _End, waiting: Queue[Item | _End], closed: Event) -> None:
    """Queue an item as soon as there is room, unless the consumer has closed."""
    while not closed.is_set():
        with suppress(Full):
            waiting.put(item, timeout=_POLL_S)
            return
