"""Files appear whole or not at all, go back for nothing, have one writer at a time, and are read
again when, and only when, they may have changed."""

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from imocap_core import limits
from imocap_core.artifacts import file_memory, side_files
from imocap_core.artifacts.file_memory import files_below, load_memory, remembered, save_memory
from imocap_core.artifacts.schemas import Sync
from imocap_core.artifacts.store import (
    Store,
    Stored,
    cached_results,
    leftovers,
    mark_used,
    remove,
    size_of,
    sweep,
)
from imocap_core.errors import ArtifactCorrupt, WorkFailed
from imocap_core.files import (
    RECORD,
    atomic_write,
    draft_folder,
    record_made,
    write_whole,
    writer_has_ended,
)
from imocap_core.pipeline.source import content_digest


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
    assert found.decode(Sync).status == "first"
    assert found.content.provenance == {"seed": "7", "key": "one"}
    assert store.find("yoga", "sync", "three") is None
    current = store.load("yoga", "sync")
    assert current.key == "two"


def test_other_actions_share_results_but_not_the_current_one(store: Store, put: Put) -> None:
    put("one")
    assert store.find("dance", "sync", "one") is not None
    assert store.load("dance", "sync") is None


def test_a_lost_cache_is_no_loss_for_the_current_artifact(store: Store, put: Put) -> None:
    put("one")
    store.cached("sync", "one").unlink()
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
    files = [p for p in store.folder.rglob("*") if p.is_file()]
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


def test_what_the_program_added_to_the_report_stays_until_the_result_changes(store, put):
    report = store.folder / "yoga" / "report"
    put("one", files={"a.csv": b"1"})
    (report / "viewer.html").write_bytes(b"made from one")
    record_made(report, ["viewer.html"])
    current = store.find("yoga", "sync", "one")
    store.publish("yoga", "sync", current)
    assert {p.name for p in report.iterdir()} == {"a.csv", "viewer.html", RECORD}
    (report / "a.csv").unlink()
    store.publish("yoga", "sync", current)
    assert (report / "a.csv").read_bytes() == b"1"
    (report / "viewer.html").write_bytes(b"made from one")
    record_made(report, ["viewer.html"])
    put("two", files={"a.csv": b"1"})
    assert {p.name for p in report.iterdir()} == {"a.csv", RECORD}


def test_what_people_put_into_the_report_or_change_there_is_never_lost(store, put):
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


def test_a_report_that_cannot_be_replaced_stays(store, put, monkeypatch):
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
        assert other.stdout.readline() == "held\n"
        with store.lock("dance", lambda: pytest.fail("another action must not wait")):
            pass
        waited = []

        def other_dies() -> None:
            waited.append(True)
            other.kill()

        with store.lock("yoga", other_dies):
            assert waited == [True]


DAY_S = 86400.0


@pytest.fixture
def publish_at(store: Store, sync: Sync) -> Callable[[str, str], Path]:
    def publish(key: str, action: str) -> Path:
        stored = store.find(action, "sync", key) or store.put("sync", key, sync, {}, {})
        store.publish(action, "sync", stored)
        return store.cached("sync", key)

    return publish


def test_use_is_recorded_by_the_access_time_and_not_by_the_content_time(store, publish_at):
    file = publish_at("one", "yoga")
    os.utime(file, (1000.0, 1000.0))
    assert cached_results(store.folder)[0].used_s == 1000.0
    publish_at("one", "yoga")
    assert cached_results(store.folder)[0].used_s > 1000.0 + DAY_S
    assert file.stat().st_mtime == 1000.0
    mark_used(store.folder, "sync", "gone")
    assert [r.key for r in cached_results(store.folder)] == ["one"]


def test_leftovers_are_unfinished_files_and_folders(store, publish_at):
    publish_at("one", "yoga")
    assert leftovers(store.folder) == []
    for name in (".cache/sync/.abc.part", "yoga/.sync.mcap.12.part"):
        (store.folder / name).write_bytes(b"half")
    for name in (".cache/detections/.detect-x", "yoga/.report-ab", "yoga/.report-ab-old"):
        (store.folder / name).mkdir(parents=True)
        (store.folder / name / "file").write_bytes(b"half")
    paths = leftovers(store.folder)
    assert len(paths) == 5
    assert sum(map(size_of, paths)) == 20
    assert leftovers(store.folder, "yoga") == paths
    in_cache = [path for path in paths if ".cache" in path.parts]
    assert leftovers(store.folder, "serve") == in_cache
    remove(paths)
    assert leftovers(store.folder) == []
    assert {p.name for p in store.folder.rglob("*.mcap")} == {"one.mcap", "sync.mcap"}


def abandoned_draft(folder: Path, kind: str = "atomic_write(folder / 'one.mcap')") -> Path:
    """What a process that was killed while it wrote leaves in a folder."""
    code = (
        "import sys, os; from pathlib import Path; from imocap_core.files import *\n"
        "folder = Path(sys.argv[1])\n"
        f"with {kind} as draft: print(draft, flush=True); os._exit(9)"
    )
    line = [sys.executable, "-c", code, str(folder)]
    return Path(subprocess.run(line, capture_output=True, text=True, check=False).stdout.strip())


def test_folders_that_another_run_removes_meanwhile_are_no_fault(store, monkeypatch):
    draft = store.folder / "walk" / ".stage-ept0sdc2"
    draft.mkdir(parents=True)
    scandir = os.scandir

    def vanishing(folder: str | Path) -> object:
        if Path(folder) == draft:
            raise FileNotFoundError(folder)
        return scandir(folder)

    monkeypatch.setattr(os, "scandir", vanishing)
    assert leftovers(store.folder) == [draft]


def test_drafts_of_ended_processes_are_swept_and_others_stay(store: Store) -> None:
    folder = store.folder / ".cache" / "sync"
    with atomic_write(folder / "two.mcap") as draft:
        elsewhere = folder / ".elsewhere-1-x.part.mcap"
        elsewhere.write_bytes(b"half")
        abandoned = abandoned_draft(folder)
        assert abandoned.exists()
        assert writer_has_ended(abandoned)
        assert not writer_has_ended(draft)
        sweep(store.folder, "yoga")
        assert sorted(folder.iterdir()) == sorted([draft, elsewhere])


def test_the_next_file_of_a_folder_removes_abandoned_drafts(tmp_path: Path) -> None:
    abandoned = abandoned_draft(tmp_path)
    assert abandoned.exists()
    write_whole(tmp_path / "page.html", "text")
    assert [file.name for file in tmp_path.iterdir()] == ["page.html"]


def test_the_next_folder_of_drafts_removes_abandoned_ones(tmp_path: Path) -> None:
    abandoned = abandoned_draft(tmp_path, "draft_folder(folder, 'export')")
    assert abandoned.is_dir()
    (tmp_path / ".export-mine").mkdir()
    with draft_folder(tmp_path, "export") as fresh:
        assert sorted(tmp_path.iterdir()) == sorted([tmp_path / ".export-mine", fresh])
    assert [file.name for file in tmp_path.iterdir()] == [".export-mine"]


@pytest.mark.parametrize("place", ["other", "yoga/report", ".cache/sync", ".cache/more"])
def test_nothing_behind_a_link_is_a_leftover(store: Store, tmp_path: Path, place: str) -> None:
    elsewhere = tmp_path / "elsewhere"
    theirs = [elsewhere / name for name in (".report-1", ".a.mcap.part", "sub/.b.part2")]
    for file in theirs:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
        os.utime(file, (0.0, 0.0))
    link = store.folder / place
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(elsewhere)
    (link.parent / ".mine.part").touch()
    os.utime(link.parent / ".mine.part", (0.0, 0.0))
    sweep(store.folder, "yoga")
    assert all(file.exists() for file in theirs)
    assert link.is_symlink()
    assert not (link.parent / ".mine.part").exists() or place == "other"


LONG_AGO_S = 1_600_000_000


class Reader:
    """Returns a file's text, or a folder's file names, and counts how often it did."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, path: Path) -> str:
        self.count += 1
        return ",".join(files_below(path)) if path.is_dir() else path.read_text()


@pytest.fixture
def reader() -> Reader:
    return Reader()


@pytest.fixture
def forget(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Begin with nothing remembered; called, as a new process would."""

    def anew() -> None:
        memory = file_memory._Memory()
        monkeypatch.setattr(file_memory, "_memory", lambda: memory)

    anew()
    return anew


def written(file: Path, text: str, age: int = 0) -> Path:
    """A file that was last changed long ago, `age` seconds after others of age 0."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    os.utime(file, (LONG_AGO_S + age, LONG_AGO_S + age))
    return file


def test_an_unchanged_file_is_read_once(tmp_path, reader, forget):
    file = written(tmp_path / "a", "one")
    assert [remembered("text", file, reader) for _ in range(3)] == ["one"] * 3
    assert reader.count == 1
    assert remembered("other", file, reader) == "one"
    assert reader.count == 2


@pytest.mark.parametrize("text", ["two", "longer"])
def test_a_changed_file_is_read_again(tmp_path, reader, forget, text):
    file = written(tmp_path / "a", "one")
    remembered("text", file, reader)
    written(file, text, age=1)
    assert remembered("text", file, reader) == text


def test_another_file_in_its_place_is_read_though_size_and_time_agree(tmp_path, reader, forget):
    file = written(tmp_path / "a", "one")
    remembered("text", file, reader)
    written(tmp_path / "b", "two").replace(file)
    assert remembered("text", file, reader) == "two"


def test_a_file_that_has_just_changed_is_not_remembered(tmp_path, reader, forget):
    file = tmp_path / "a"
    file.write_text("one")
    remembered("text", file, reader)
    remembered("text", file, reader)
    assert reader.count == 2


def test_a_folder_changes_with_each_of_its_files(tmp_path, reader, forget):
    folder = tmp_path / "folder"
    written(folder / "sub" / "b", "1")
    written(folder / "a", "1")
    os.utime(folder, (LONG_AGO_S, LONG_AGO_S))
    assert remembered("names", folder, reader) == "a,sub/b"
    remembered("names", folder, reader)
    assert reader.count == 1
    written(folder / "sub" / "b", "2", age=1)
    remembered("names", folder, reader)
    assert reader.count == 2
    written(folder / "sub" / "c", "1")
    assert remembered("names", folder, reader) == "a,sub/b,sub/c"


def test_the_next_process_remembers(tmp_path, reader, forget):
    store = tmp_path / "artifacts"
    store.mkdir()
    file, lost = written(tmp_path / "a", "one"), written(tmp_path / "b", "gone")
    remembered("text", file, reader)
    remembered("text", lost, reader)
    lost.unlink()
    save_memory(store)
    forget()
    load_memory(store)
    assert remembered("text", file, reader) == "one"
    assert reader.count == 2
    assert str(lost) not in (store / file_memory.FILE).read_text()
    assert [p.name for p in (store / ".cache").iterdir()] == ["files.json"]


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"made_by": "other", "entries": {}}', '{"a": 1}', 100_000 * "["]
)
def test_a_damaged_or_foreign_memory_is_as_none(tmp_path, reader, forget, text):
    written(tmp_path / file_memory.FILE, text)
    load_memory(tmp_path)
    file = written(tmp_path / "a", "one")
    assert remembered("text", file, reader) == "one"


def test_nothing_is_made_where_there_is_no_store(tmp_path, reader, forget):
    remembered("text", written(tmp_path / "a", "one"), reader)
    save_memory(tmp_path / "artifacts")
    assert not (tmp_path / "artifacts").exists()


def test_a_missing_file_is_an_error(tmp_path, reader, forget):
    with pytest.raises(FileNotFoundError):
        remembered("text", tmp_path / "nowhere", reader)


@pytest.mark.parametrize(("limit", "most"), [("MAX_FOLDER_FILES", 3), ("MAX_FOLDER_BYTES", 30)])
def test_a_folder_of_a_whole_disk_is_no_input(tmp_path, monkeypatch, limit, most):
    for name in ("a", "b", "c"):
        (tmp_path / name).write_text(10 * "x")
    monkeypatch.setattr(limits, limit, most)
    digest = content_digest(tmp_path)
    (tmp_path / "c").write_text(11 * "x")
    if limit == "MAX_FOLDER_FILES":
        assert content_digest(tmp_path) != digest
        (tmp_path / "d").touch()
    with pytest.raises(WorkFailed, match=f"cannot read {tmp_path}: more than"):
        content_digest(tmp_path)
