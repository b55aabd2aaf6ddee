"""`--store`: what one machine has made, others need not; what the store refuses is not lost."""

from __future__ import annotations

import errno
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from imocap_core.artifacts import shared_store
from imocap_core.artifacts.shared_store import FolderFiles

if TYPE_CHECKING:
    from tests.pipeline.conftest import Toy

Capture = pytest.CaptureFixture[str]
STAGES = ["gather", "scale", "evaluate"]


@pytest.fixture
def store(tmp_path: Path) -> Path:
    (tmp_path / "shared").mkdir()
    return tmp_path / "shared"


def forget(toy: Toy) -> None:
    """As on another machine: nothing is stored here."""
    shutil.rmtree(toy.root / "artifacts")


def published(store: Path) -> list[str]:
    return sorted(file.parent.name for file in store.glob("results/*/*.mcap"))


def test_a_result_of_the_store_is_not_made_again(
    toy: Toy, store: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    assert toy.imocap(["run", "toy", "--store", str(store)]) == 0
    assert toy.ran() == STAGES
    assert published(store) == sorted(STAGES)
    digests = toy.digests()
    forget(toy)
    assert toy.imocap(["status", "toy"]) == 0
    assert "never run" in capsys.readouterr().out
    monkeypatch.setenv("IMOCAP_STORE", str(store))
    assert toy.imocap(["status", "toy"]) == 0
    assert "would run" not in capsys.readouterr().out
    for command in ("run", "run-all"):
        forget(toy)
        assert toy.imocap([command, "toy"]) == 0
        assert toy.ran() == []
        assert toy.digests() == digests
        assert (toy.root / "artifacts/toy/report/index.md").is_file()


def test_several_processes_of_one_machine_publish_what_they_make(toy: Toy, store: Path) -> None:
    assert toy.imocap(["run-all", "toy", "--workers", "2", "--store", str(store)]) == 0
    assert published(store) == sorted(STAGES)


def test_a_run_goes_on_where_the_store_refused_it(
    toy: Toy, store: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setattr(shared_store, "FIRST_PAUSE_S", 0.01)
    monkeypatch.setattr(shared_store, "PATIENCE_S", 0.1)

    def busy(self: FolderFiles, file: Path, name: str) -> None:
        raise OSError(errno.EBUSY, "Please reduce your request rate")

    with monkeypatch.context() as outage:
        outage.setattr(FolderFiles, "publish", busy)
        assert toy.imocap(["run", "toy", "--store", str(store)]) == 1
    sentence = capsys.readouterr().err
    assert "did not answer" in sentence
    assert "run again to go on, and to publish it" in sentence
    assert toy.ran() == ["gather"]
    assert toy.imocap(["run", "toy"]) == 0
    assert toy.ran() == ["scale", "evaluate"]
    assert published(store) == []
    assert toy.imocap(["run", "toy", "--store", str(store)]) == 0
    assert toy.ran() == []
    assert published(store) == sorted(STAGES)


def test_a_disk_that_is_full_while_a_result_is_fetched_is_a_sentence(
    toy: Toy, store: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    assert toy.imocap(["run", "toy", "--store", str(store)]) == 0
    forget(toy)
    toy.ran()

    def full(self: FolderFiles, name: str, file: Path) -> bool:
        raise OSError(errno.ENOSPC, "No space left on device", "the source")

    with monkeypatch.context() as small:
        small.setattr(FolderFiles, "fetch", full)
        assert toy.imocap(["run", "toy", "--store", str(store)]) == 1
    assert f"the disk is full ({toy.root / 'artifacts'}" in capsys.readouterr().err
    assert toy.ran() == []
    assert toy.imocap(["run", "toy", "--store", str(store)]) == 0
    assert toy.ran() == []


def test_push_and_pull_say_what_they_did(toy: Toy, store: Path, capsys: Capture) -> None:
    capsys.readouterr()
    assert toy.imocap(["push", "toy", "--store", str(store)]) == 0
    assert capsys.readouterr().out == ("toy: 3 files, 3 of them new there; results of 0 stages.\n")
    assert toy.imocap(["pull", "toy", "--store", str(store)]) == 0
    assert "actions/toy: was here; results of 0 stages." in capsys.readouterr().out
    assert toy.imocap(["pull", "toy"]) == 2
    assert "expected --store URL" in capsys.readouterr().err
