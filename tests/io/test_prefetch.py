"""Items made ahead: the same ones, errors in their place, and an end when they are not wanted."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from imocap_core.io.frame_access import prefetch


def test_the_same_items_in_the_same_order() -> None:
    assert list(prefetch(range(50), depth=3)) == list(range(50))
    assert list(prefetch([])) == []
    with pytest.raises(ValueError, match="depth: expected at least 1, got 0"):
        next(prefetch([1], depth=0))


def test_an_error_comes_after_the_items_before_it() -> None:
    def broken() -> Iterator[int]:
        yield 1
        yield 2
        raise OSError("the disk is gone")

    items = []
    with pytest.raises(OSError, match="the disk is gone"):
        items.extend(prefetch(broken()))
    made = prefetch(broken())
    assert [next(made), next(made)] == [1, 2]
    with pytest.raises(OSError, match="the disk is gone"):
        next(made)


def test_the_making_is_in_another_thread_and_never_far_ahead() -> None:
    made: list[int] = []
    threads = set()

    def counted() -> Iterator[int]:
        for n in range(100):
            made.append(n)
            threads.add(threading.get_ident())
            yield n

    for n in prefetch(counted(), depth=2):
        assert len(made) <= n + 5  # this one, two that wait, one in hand, one being made
    assert threads != {threading.get_ident()}
    assert len(made) == 100


def test_making_ends_when_no_more_are_wanted() -> None:
    closed = threading.Event()

    def endless() -> Iterator[int]:
        try:
            while True:
                yield 1
        finally:
            closed.set()

    source = endless()
    made = prefetch(source)
    assert next(made) == 1
    before = threading.active_count()
    made.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before - 1
    source.close()
    assert closed.is_set()
