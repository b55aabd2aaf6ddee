"""Make things while others are being used: a generator that runs a few items ahead, in a thread."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from queue import Full, Queue
from threading import Event, Thread
from typing import TypeVar

Item = TypeVar("Item")
_PATIENCE_S = 0.1


@dataclass(frozen=True)
class _End:
    """Behind the last item: the error that ended the making, if one did."""

    error: BaseException | None = None


def prefetch(items: Iterable[Item], depth: int = 4) -> Iterator[Item]:
    """The same items in the same order, made in a thread, at most `depth` of them waiting.

    An error in making one is raised here, after the items before it. When no more are wanted (the
    generator is closed), the making ends before its next item.
    """
    if depth < 1:
        raise ValueError(f"depth: expected at least 1, got {depth}")
    waiting: Queue[Item | _End] = Queue(depth)
    unwanted = Event()
    maker = Thread(target=_make, args=(items, waiting, unwanted), daemon=True)
    maker.start()
    try:
        while not isinstance(item := waiting.get(), _End):
            yield item
        if item.error is not None:
            raise item.error
    finally:
        unwanted.set()
        maker.join()


def _make(items: Iterable[Item], waiting: Queue[Item | _End], unwanted: Event) -> None:
    """Make items until there are no more, one fails, or they are unwanted; say so at the end."""
    end = _End()
    try:
        for item in items:
            _offer(item, waiting, unwanted)
            if unwanted.is_set():
                return
    except BaseException as error:
        end = _End(error)
    _offer(end, waiting, unwanted)


def _offer(item: Item | _End, waiting: Queue[Item | _End], unwanted: Event) -> None:
    """Put an item where it is waited for, as soon as there is room, unless it is unwanted."""
    while not unwanted.is_set():
        with suppress(Full):
            waiting.put(item, timeout=_PATIENCE_S)
            return
