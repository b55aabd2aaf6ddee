"""Files appear whole or not at all, go back for nothing, and have one writer at a time."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from imocap_core.artifacts import side_files
from imocap_core.artifacts.schemas import Sync
from imocap_core.artifacts.store import Store, Stored
from imocap_core.errors import ArtifactCorrupt
from imocap_core.files import RECORD, record_made


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "artifacts")


Put = Callable[..., Stored]


@pytest.fixture
def put(store: Store, sync: Sync) -> Put:
    def keep(key: str, status: str = "", files: dict[str, bytes] | None = None) -> Stored:
        artifact = sync.model_copy(update={"status": status})
        stored = store.put("sync", key, artifact, {"seed": "7"}, files or {})
        store.publish("yoga", "sync", stored)
        return stored

    return keep


def test_a_result_is_found_by_its_key(store: Store, put: Put) -> None:
    put("one", "first")
    put("two", "second")
    found = store.find("yoga", "sync", "one")
    assert found is not None
    assert found.decode(Sync).status == "first"
    assert found.content.provenance == {"seed": "7", "key": "one"}
    assert store.find("yoga", "sync", "three") is None
    current = store.load("yoga", "sync")
    assert current is not None
    assert current.key == "two"


def test_other_actions_share_results_but_not_the_current_one(store: Store, put: Put) -> None:
    put("one")
    assert store.find("dance", "sync", "one") is not None
    assert store.load("dance", "sync") is None


def test_a_lost_cache_is_no_loss_for_the_current_artifact(store: Store, put: Put) -> None:
    put("one")
    store.cached("sync", "one").unlink()
    assert store.find("yoga", "sync", "one") is not None


def test_a_damaged_file_is_no_result(store: Store, put: Put) -> None:
    stored = put("one")
    data = bytearray(stored.file.read_bytes())
    data[len(data) // 2] ^= 4
    stored.file.write_bytes(data)  # the current artifact is the same file
    assert store.find("yoga", "sync", "one") is None
    with pytest.raises(ArtifactCorrupt):
        store.load("yoga", "sync")
    put("one")
    assert store.find("yoga", "sync", "one") is not None


def test_what_was_read_is_read_again_and_must_be_the_same(put: Put) -> None:
    unread = put("one", "first", files={"a.csv": b"1"}).unread()
    assert unread.decode(Sync).status == "first"
    assert unread.content.files == {"a.csv": b"1"}
    replaced = unread.unread()
    replaced.file.write_bytes(put("two", "second").file.read_bytes())
    with pytest.raises(ArtifactCorrupt, match="was replaced meanwhile; run again"):
        replaced.decode(Sync)


def test_nothing_half_written_stays(store: Store, put: Put, sync: Sync) -> None:
    put("one")
    with pytest.raises(AttributeError):
        store.put("sync", "two", sync, {"bad": 1}, {})  # type: ignore[dict-item]
    put("one")  # again, over itself
    files = [p for p in store.folder.rglob("*") if p.is_file() and p.parent.name != ".used"]
    names = {p.name for p in files}
    assert names == {"one.mcap", "sync.mcap"}


def test_side_files_become_the_report(store: Store, put: Put) -> None:
    report = store.folder / "yoga" / "report"
    first = put("one", files={"index.html": b"1", "figures/a.png": b"22"})
    assert (report / "figures" / "a.png").read_bytes() == b"22"
    put("two", files={"index.html": b"new"})
    assert {p.name for p in report.rglob("*")} == {"index.html", RECORD}
    store.publish("yoga", "sync", first)
    (report / "index.html").unlink()
    store.publish("yoga", "sync", first)
    assert (report / "index.html").read_bytes() == b"1"
    put("three", files={"index.html": b"3"})
    assert {p.name for p in report.iterdir()} == {"index.html", RECORD}
    assert (report / "index.html").read_bytes() == b"3"
    assert [p.name for p in report.parent.iterdir() if p.name.startswith(".report")] == []


def test_what_the_program_added_to_the_report_stays_until_the_result_changes(
    store: Store, put: Put
) -> None:
    report = store.folder / "yoga" / "report"
    put("one", files={"a.csv": b"1"})
    (report / "viewer.html").write_bytes(b"made from one")
    record_made(report, ["viewer.html"])
    current = store.find("yoga", "sync", "one")
    assert current is not None
    store.publish("yoga", "sync", current)
    assert {p.name for p in report.iterdir()} == {"a.csv", "viewer.html", RECORD}
    (report / "a.csv").unlink()
    store.publish("yoga", "sync", current)
    assert (report / "a.csv").read_bytes() == b"1"
    (report / "viewer.html").write_bytes(b"made from one")
    record_made(report, ["viewer.html"])
    put("two", files={"a.csv": b"1"})
    assert {p.name for p in report.iterdir()} == {"a.csv", RECORD}


def test_what_people_put_into_the_report_or_change_there_is_never_lost(
    store: Store, put: Put
) -> None:
    report = store.folder / "yoga" / "report"
    put("one", files={"a.csv": b"1", "figures/b.png": b"1"})
    (report / "notes.txt").write_text("mine")
    (report / "figures" / "c.png").write_bytes(b"mine")
    (report / "a.csv").write_bytes(b"changed")
    put("two", files={"a.csv": b"2"})
    content = {p.relative_to(report).as_posix(): p for p in report.rglob("*") if p.is_file()}
    assert content.keys() == {RECORD, "a.csv", "a.csv~", "notes.txt", "figures/c.png"}
    assert content["a.csv"].read_bytes() == b"2"
    assert content["a.csv~"].read_bytes() == b"changed"
    (report / "a.csv").write_bytes(b"changed again")
    put("three", files={"a.csv": b"3"})
    assert (report / "a.csv~").read_bytes() == b"changed"
    assert (report / "a.csv~~").read_bytes() == b"changed again"
    assert (report / "figures" / "c.png").read_bytes() == b"mine"


def test_a_report_that_cannot_be_replaced_stays(
    store: Store, put: Put, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = store.folder / "yoga" / "report"
    put("one", files={"a.csv": b"1"})
    (report / "notes.txt").write_text("mine")
    replace = os.replace

    def replaced(source: Path, target: Path) -> None:
        if Path(target) == report and not Path(source).name.endswith("-old"):
            raise OSError(errno.ENOSPC, "no room")
        replace(source, target)

    monkeypatch.setattr(side_files.os, "replace", replaced)
    with pytest.raises(OSError, match="no room"):
        put("two", files={"a.csv": b"2"})
    assert (report / "notes.txt").read_text() == "mine"
    assert (report / "a.csv").read_bytes() == b"1"
    assert [p.name for p in report.parent.iterdir() if p.name.startswith(".report")] == []


HOLD = """
import sys
from pathlib import Path
from imocap_core.artifacts.store import Store
with Store(Path(sys.argv[1])).lock("yoga", lambda: None):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_an_action_has_one_run_at_a_time(store: Store) -> None:
    command = [sys.executable, "-c", HOLD, str(store.folder)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with store.lock("dance", lambda: pytest.fail("another action must not wait")):
            pass
        waited = []

        def other_dies() -> None:
            waited.append(True)
            other.kill()

        with store.lock("yoga", other_dies):
            assert waited == [True]
