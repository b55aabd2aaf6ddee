"""Work on threads says what work in turn says, on any system; stages compute with one thread
whatever the environment says."""

import json
import os
import subprocess
import sys

import pytest

from imocap_core import workers
from imocap_core.workers import cores, serial_map, thread_map


@pytest.fixture(autouse=True)
def of_no_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(workers._of_thread, "cores", raising=False)


def test_thread_map_answers_in_the_order_asked() -> None:
    items = list(range(20))
    assert thread_map(lambda n: n * n, items) == serial_map(lambda n: n * n, items)
    assert thread_map(lambda n: n, []) == []


def test_workers_share_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work that is on a thread of its own does not start as many threads once more."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(5), raising=False)
    assert thread_map(lambda _: cores(), range(2)) == [2, 2]
    assert thread_map(lambda _: cores(), range(7)) == [1] * 7
    assert thread_map(lambda _: thread_map(lambda _: cores(), range(2)), range(2)) == [[1, 1]] * 2
    assert thread_map(lambda _: cores(), range(2), most=1) == [5, 5]
    assert cores() == 5


def test_systems_that_do_not_tell_what_a_process_may_use_let_it_use_all(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert cores() == 7
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert cores() == 1


PROGRAM = """
import json
from threadpoolctl import threadpool_info
from imocap_core.process import configure_process
before = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
configure_process()
import cv2
import torch
after = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
print(json.dumps([before, after, torch.get_num_threads(), cv2.getNumThreads()]))
"""


@pytest.mark.long
def test_linear_algebra_has_one_thread_where_a_run_begins() -> None:
    environment = {**os.environ, "OMP_NUM_THREADS": "3", "OPENBLAS_NUM_THREADS": "3"}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    before, after, of_torch, of_opencv = json.loads(done.stdout)
    assert after
    assert set(after) == {1}
    assert of_torch == of_opencv == 1
    assert all(count == 3 for count in before)
