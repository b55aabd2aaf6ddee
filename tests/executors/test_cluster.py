"""Tasks on a Dask cluster of this machine."""

import socket
import sys
from pathlib import Path

import pytest

from imocap_core.errors import WorkFailed
from imocap_core.executors.processes import dask_cluster
from imocap_core.executors.tasks import Begun, Progressed, Task, perform
from tests.executors.work import die_once, note, refuse
from tests.processes import at_most

pytest.importorskip("distributed", reason="the extra dask is not installed")


@pytest.mark.skipif(sys.platform != "linux", reason="kills a process as Linux does")
def test_a_graph_on_a_cluster_survives_a_worker_killed_by_signal(tmp_path: Path) -> None:
    events: list[Begun | Progressed] = []
    file = tmp_path / "notes"
    tasks = [
        Task("die", die_once, (tmp_path / "died",)),
        Task("broken", refuse, ("no keypoints",)),
        Task("after broken", note, (file, "never"), ("broken",)),
        Task("first", note, (file, "first"), ("die",)),
        Task("second", note, (file, "second"), ("first",)),
    ]
    with at_most(300), dask_cluster(2) as cluster:
        ends = {e.task.name: e for e in perform(tasks, cluster, events.append)}
    assert [ends[t.name].state for t in tasks] == ["done", "failed", "skipped", "done", "done"]
    assert ends["broken"].fault == "no keypoints"
    assert file.read_text().split() == ["first", "second"]
    assert any(isinstance(e, Begun) and e.task.name == "first" for e in events)


def test_workers_that_have_all_ended_are_a_sentence(monkeypatch, tmp_path):
    monkeypatch.setattr("imocap_core.executors.processes.WORKERS", "pass")
    monkeypatch.setattr("imocap_core.executors.processes.LOOK_S", 0.1)
    task = Task("t", note, (tmp_path / "notes", "text"))
    with at_most(300), dask_cluster(1) as cluster, pytest.raises(WorkFailed, match="have ended"):
        list(perform([task], cluster))


def test_a_scheduler_that_does_not_answer_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imocap_core.executors.processes.CONNECT_S", 1)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{unused.getsockname()[1]}"
    with (
        pytest.raises(WorkFailed, match=f"no Dask scheduler answers at {address}"),
        dask_cluster(1, address),
    ):
        pass


def test_a_cluster_that_exists_is_used_and_left_running(tmp_path: Path) -> None:
    from distributed import Client, LocalCluster

    with LocalCluster(
        1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as c:
        with dask_cluster(1, c.scheduler_address) as cluster:
            (end,) = perform([Task("t", note, (tmp_path / "notes", "text"))], cluster)
        assert end.state == "done"
        with Client(c.scheduler_address) as client:
            assert client.submit(abs, -1).result(timeout=120) == 1
