"""Graphs of tasks: order, priority, failures and retries, the same for every executor."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import pytest

from imocap_core.executors.processes import worker_processes
from imocap_core.executors.tasks import Begun, Executor, Progressed, Report, Serial, Task, perform
from imocap_core.workers import cores
from tests.executors.work import die_once, note, refuse
from tests.processes import is_running, must_end, plant

needs_proc = pytest.mark.skipif(sys.platform != "linux", reason="kills a process as Linux does")


@contextmanager
def serial() -> Iterator[Executor]:
    yield Serial()


def processes() -> AbstractContextManager[Executor]:
    return worker_processes(2)


EXECUTORS = pytest.mark.parametrize("executor", [serial, processes])


def chain(name: str, file: Path, steps: int, priority: int = 0) -> list[Task]:
    names = [f"{name}{i}" for i in range(steps)]
    return [
        Task(n, note, (file, n), tuple(names[max(0, i - 1) : i]), priority)
        for i, n in enumerate(names)
    ]


@EXECUTORS
def test_every_task_comes_after_those_that_it_names(executor: Any, tmp_path: Path) -> None:
    tasks = [*chain("a", tmp_path / "a", 4), *chain("b", tmp_path / "b", 4)]
    with executor() as chosen:
        ends = list(perform(tasks, chosen))
    assert {end.task.name for end in ends} == {task.name for task in tasks}
    assert all(end.state == "done" and end.attempts == 1 for end in ends)
    for name in ("a", "b"):
        assert (tmp_path / name).read_text().split() == [f"{name}{i}" for i in range(4)]


@EXECUTORS
def test_a_failure_stops_what_comes_after_it_and_nothing_else(executor, tmp_path):
    first, *others = chain("a", tmp_path / "a", 3)
    broken = Task(first.name, refuse, ("no keypoints",))
    with executor() as chosen:
        ends = {
            e.task.name: e
            for e in perform([broken, *others, *chain("b", tmp_path / "b", 2)], chosen)
        }
    assert [(ends[n].state, ends[n].fault) for n in ("a0", "a1", "a2")] == [
        ("failed", "no keypoints"),
        ("skipped", "a0 failed"),
        ("skipped", "a0 failed"),
    ]
    assert ends["b0"].state == ends["b1"].state == "done"
    assert not (tmp_path / "a").exists()


@EXECUTORS
def test_a_fault_of_the_program_is_a_sentence(executor: Any) -> None:
    with executor() as chosen:
        (end,) = perform([Task("t", divide, (0,))], chosen)
    assert end.state == "failed"
    assert end.fault.startswith("ZeroDivisionError")


def divide(report: Report, by: int) -> float:
    return 1 / by


@EXECUTORS
def test_progress_names_its_task(executor: Any, tmp_path: Path) -> None:
    events: list[Begun | Progressed] = []
    with executor() as chosen:
        list(perform(chain("a", tmp_path / "a", 2), chosen, events.append))
    told = [(type(e).__name__, e.task.name) for e in events]
    assert told == [(k, n) for n in ("a0", "a1") for k in ("Begun", "Progressed")]
    assert events[1] == Progressed(events[1].task, 0.5, "a0")


def test_what_has_priority_begins_first(tmp_path: Path) -> None:
    file = tmp_path / "order"
    tasks = [*chain("late", file, 2, priority=1), *chain("early", file, 2, priority=0)]
    list(perform(tasks, Serial()))
    assert file.read_text().split() == ["early0", "early1", "late0", "late1"]


def test_a_graph_with_a_cycle_is_refused() -> None:
    tasks = [Task("a", note, (), ("b",)), Task("b", note, (), ("a",))]
    with pytest.raises(ValueError, match="cycle"):
        list(perform(tasks, Serial()))


def test_workers_share_the_cores() -> None:
    with worker_processes(cores()) as executor:
        (end,) = perform([Task("c", own_cores)], executor)
    assert end.result == 1


def own_cores(report: Report) -> int:
    return cores()


@needs_proc
def test_a_worker_that_is_killed_is_replaced_and_its_task_tried_again(tmp_path: Path) -> None:
    tasks = [Task("d", die_once, (tmp_path / "died",)), *chain("a", tmp_path / "a", 3)]
    with worker_processes(2) as executor:
        ends = {e.task.name: e for e in perform(tasks, executor, retries=1)}
    assert ends["d"].state == "done"
    assert ends["d"].attempts == 2
    assert all(ends[f"a{i}"].state == "done" for i in range(3))


def fill_memory(report: Report) -> None:
    raise MemoryError


def test_a_task_that_runs_out_of_memory_fails_with_a_sentence() -> None:
    with worker_processes(1) as executor:
        (end,) = perform([Task("m", fill_memory)], executor)
    assert end.state == "failed"
    assert end.fault == "not enough memory: close other programs, or use fewer frames"


def threads(report: Report) -> str | None:
    return os.environ.get("OMP_NUM_THREADS")


def test_workers_compute_with_one_thread_and_the_outer_process_as_before(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "5")
    with worker_processes(1) as executor:
        (end,) = perform([Task("t", threads)], executor)
    assert end.result == "1"
    assert os.environ["OMP_NUM_THREADS"] == "5"


def sleep(report: Report, file: Path) -> None:
    file.write_text(str(os.getpid()))
    time.sleep(3600)


@needs_proc
def test_workers_end_with_the_body(tmp_path: Path) -> None:
    file = tmp_path / "pid"

    def stop_when_begun(event: object) -> None:
        while not file.exists() or not file.read_text():
            time.sleep(0.01)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), worker_processes(1) as executor:
        list(perform([Task("s", sleep, (file,))], executor, stop_when_begun))
    pid = int(file.read_text())
    end = time.monotonic() + 30
    while Path(f"/proc/{pid}").exists() and time.monotonic() < end:
        time.sleep(0.05)
    assert not Path(f"/proc/{pid}").exists()
    assert threading.active_count() < 20


def test_workers_import_nothing_from_the_working_folder(tmp_path, monkeypatch):
    trace = plant(tmp_path, "multiprocessing", "json", "pickle")
    monkeypatch.chdir(tmp_path)
    with worker_processes(1) as executor:
        (end,) = perform([Task("t", threads)], executor)
    assert end.state == "done"
    assert not trace.exists()


def speak(report: Report) -> None:
    print("what a task prints is no event")  # noqa: T201
    os.write(1, b"nor is what its libraries print\n")


def test_what_a_task_prints_is_no_event() -> None:
    with worker_processes(1) as executor:
        ends = list(perform([Task("a", speak), Task("b", threads)], executor))
    assert [end.state for end in ends] == ["done", "done"]


# A script without `if __name__ == "__main__"`: multiprocessing's workers would run it again.
SCRIPT = """
import os
from imocap_core.executors.tasks import perform
from imocap_core.executors.processes import worker_processes
from imocap_core.executors.tasks import Task
from tests.executors.work import stay
print("begun", flush=True)
with worker_processes(1) as executor:
    list(perform([Task("t", stay, ({seconds},))], executor, lambda e: print(
        getattr(e, "text", ""), flush=True)))
print("ended")
"""


@pytest.mark.parametrize("how", ["file", "stdin", "-c"])
def test_a_script_needs_no_guard(how: str, tmp_path: Path) -> None:
    script = SCRIPT.format(seconds=0)
    (tmp_path / "script.py").write_text(script)
    words = {"file": ["script.py"], "stdin": ["-"], "-c": ["-c", script]}[how]
    done = subprocess.run(
        [sys.executable, *words],
        cwd=tmp_path, env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        input=script if how == "stdin" else None, capture_output=True, text=True, check=True,
        timeout=300,
    )  # fmt: skip
    lines = done.stdout.split()
    assert (lines[0], lines[-1], len(lines)) == ("begun", "ended", 3)
    assert done.stderr == ""


@needs_proc
def test_workers_of_a_killed_process_end() -> None:
    command = [sys.executable, "-c", SCRIPT.format(seconds=3600)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        lines = [parent.stdout.readline().strip() for _ in range(3)]
        worker = int(lines[2])
        assert is_running(worker)
        parent.kill()
    must_end(worker, seconds=60)
