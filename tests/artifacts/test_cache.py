"""The cache: least recently used out, what is in use stays, leftovers of killed runs go."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from imocap_core.artifacts.schemas import Sync
from imocap_core.artifacts.store import (
    CachedResult,
    Store,
    cached_results,
    leftovers,
    mark_used,
    removable,
    remove,
    size_of,
    sweep,
)
from imocap_core.files import draft_folder, draft_of, write_whole, writer_has_ended

DAY_S = 86400.0


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "artifacts")


@pytest.fixture
def put(store: Store, sync: Sync) -> Callable[[str, str], Path]:
    def publish(key: str, action: str) -> Path:
        stored = store.find(action, "sync", key) or store.put("sync", key, sync, {}, {})
        store.publish(action, "sync", stored)
        return store.cached("sync", key)

    return publish


def result(key: str, used_s: float, *, size: int = 10, in_use: bool = False) -> CachedResult:
    return CachedResult(Path(key), "sync", key, size, used_s, in_use, frozenset({"yoga"}))


def test_current_artifacts_are_in_use_and_others_are_not(
    store: Store, put: Callable[[str, str], Path]
) -> None:
    put("one", "yoga")
    put("two", "yoga")
    put("two", "dance")
    states = {r.key: (r.in_use, r.actions) for r in cached_results(store.folder)}
    assert states == {"one": (False, {"yoga"}), "two": (True, {"yoga", "dance"})}


def test_use_is_recorded_by_the_access_time_and_not_by_the_content_time(
    store: Store, put: Callable[[str, str], Path]
) -> None:
    file = put("one", "yoga")
    os.utime(file, (1000.0, 1000.0))
    assert cached_results(store.folder)[0].used_s == 1000.0
    put("one", "yoga")
    assert cached_results(store.folder)[0].used_s > 1000.0 + DAY_S
    assert file.stat().st_mtime == 1000.0
    assert (store.folder / ".cache/.used/yoga").read_text() == "sync/one\n"
    mark_used(store.folder, "yoga", "sync", "gone")
    assert (store.folder / ".cache/.used/yoga").read_text() == "sync/one\n"


def test_detections_of_existing_actions_are_in_use(store: Store) -> None:
    files = [store.folder / ".cache" / "detections" / f"{name}.npz" for name in "ab"]
    files[0].parent.mkdir(parents=True)
    for file in files:
        file.write_bytes(b"x")
    states = {r.key: r.in_use for r in cached_results(store.folder, [files[1]])}
    assert states == {"a": False, "b": True}


def test_only_what_was_not_used_for_so_long_is_removable() -> None:
    results = [result("a", 0.0), result("b", DAY_S), result("c", 0.0, in_use=True)]
    old = removable(results, now_s=3 * DAY_S, older_s=2.5 * DAY_S)
    assert [r.key for r in old] == ["a"]
    assert removable(results, now_s=3 * DAY_S) == []


def test_the_least_recently_used_go_until_the_size_fits() -> None:
    results = [result(key, k) for k, key in enumerate("abc")]
    results.append(result("d", 9.0, in_use=True))
    assert [r.key for r in removable(results, now_s=9.0, max_bytes=25)] == ["a", "b"]
    assert [r.key for r in removable(results, now_s=9.0, max_bytes=0)] == ["a", "b", "c"]
    assert removable(results, now_s=9.0, max_bytes=40) == []
    both = removable(results, now_s=2.5, older_s=2.0, max_bytes=25)
    assert [r.key for r in both] == ["a", "b"]


def test_an_action_s_results_are_those_that_no_other_has_used(
    store: Store, put: Callable[[str, str], Path]
) -> None:
    for key, action in (("one", "yoga"), ("two", "yoga"), ("two", "dance"), ("three", "dance")):
        put(key, action)
    put("four", "yoga")
    put("four", "dance")
    results = cached_results(store.folder)
    chosen = removable(results, now_s=1e12, action="yoga", older_s=0.0)
    assert [r.key for r in chosen] == ["one"]


def test_what_is_removed_is_forgotten_and_can_be_made_again(
    store: Store, put: Callable[[str, str], Path]
) -> None:
    old = put("one", "yoga")
    put("two", "yoga")
    remove(store.folder, [old])
    assert not old.exists()
    assert (store.folder / ".cache/.used/yoga").read_text() == "sync/two\n"
    assert store.find("yoga", "sync", "one") is None
    assert put("one", "yoga").exists()


def test_leftovers_are_unfinished_files_and_folders(
    store: Store, put: Callable[[str, str], Path]
) -> None:
    put("one", "yoga")
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
    remove(store.folder, paths)
    assert leftovers(store.folder) == []
    assert {p.name for p in store.folder.rglob("*.mcap")} == {"one.mcap", "sync.mcap"}


def abandoned_draft(folder: Path, kind: str = "draft_of(folder / 'one.mcap')") -> Path:
    """What a process that was killed while it wrote leaves in a folder."""
    code = (
        "import sys, os; from pathlib import Path; from imocap_core.files import *\n"
        "folder = Path(sys.argv[1])\n"
        f"with {kind} as draft: print(draft, flush=True); os._exit(9)"
    )
    line = [sys.executable, "-c", code, str(folder)]
    return Path(subprocess.run(line, capture_output=True, text=True, check=False).stdout.strip())


def test_folders_that_another_run_removes_meanwhile_are_no_fault(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    with draft_of(folder / "two.mcap") as draft:
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


def test_a_record_of_use_may_be_damaged(store: Store, put: Callable[[str, str], Path]) -> None:
    file = put("one", "yoga")
    (store.folder / ".cache/.used/yoga").write_bytes(b"\xff\xfe\n")
    assert [r.file for r in cached_results(store.folder)] == [file]
    put("one", "yoga")
    assert cached_results(store.folder)[0].actions == {"yoga"}
