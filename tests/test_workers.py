"""Work on threads says what work in turn says, on any system."""

import multiprocessing
import os
import time

import pytest

from imocap_core.workers import at_once, cores, in_turn, processes


def test_at_once_answers_in_the_order_asked() -> None:
    items = list(range(20))
    assert at_once(lambda n: n * n, items) == in_turn(lambda n: n * n, items)
    assert at_once(lambda n: n, []) == []


def test_systems_that_do_not_tell_what_a_process_may_use_let_it_use_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert cores() == 7
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert cores() == 1


def test_processes_end_with_their_body() -> None:
    before = set(multiprocessing.active_children())
    with pytest.raises(ZeroDivisionError), processes(2) as pool:
        assert 1 / (pool.submit(time.sleep, 3600) is None)
    assert set(multiprocessing.active_children()) == before
