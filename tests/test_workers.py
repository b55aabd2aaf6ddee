"""Work on threads says what work in turn says, on any system."""

import multiprocessing
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from imocap_core.workers import at_once, cores, in_turn, processes
from tests.processes import is_running, must_end, needs_proc, plant


def test_at_once_answers_in_the_order_asked() -> None:
    items = list(range(20))
    assert at_once(lambda n: n * n, items) == in_turn(lambda n: n * n, items)
    assert at_once(lambda n: n, []) == []


def test_workers_share_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work that is on a thread of its own does not start as many threads once more."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(5), raising=False)
    assert at_once(lambda _: cores(), range(2)) == [2, 2]
    assert at_once(lambda _: cores(), range(7)) == [1] * 7
    assert at_once(lambda _: at_once(lambda _: cores(), range(2)), range(2)) == [[1, 1]] * 2
    assert at_once(lambda _: cores(), range(2), most=1) == [5, 5]
    assert cores() == 5


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


def test_processes_import_nothing_from_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trace = plant(tmp_path, "multiprocessing", "json", "pickle")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    with processes(1) as pool:
        assert pool.submit(abs, -1).result() == 1
        assert pool.submit(os.getenv, "PYTHONSAFEPATH").result() is None
    assert not trace.exists()
    assert "PYTHONSAFEPATH" not in os.environ


POOL = """
import time
from imocap_core.workers import processes
with processes(1) as pool:
    print(next(iter(pool.map(abs, [-1]))), *pool._processes, flush=True)
    pool.submit(time.sleep, 3600).result()
"""


@needs_proc
def test_processes_of_a_killed_process_end() -> None:
    command = [sys.executable, "-c", POOL]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        answer, worker = parent.stdout.readline().split()
        assert (answer, is_running(int(worker))) == ("1", True)
        parent.kill()
    must_end(int(worker), seconds=60)
