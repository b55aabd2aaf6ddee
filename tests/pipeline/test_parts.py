"""Parts of a stage's result: made once, and found by whoever needs them again."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from tests.pipeline.conftest import ACTION

if TYPE_CHECKING:
    from tests.pipeline.conftest import Toy


@pytest.fixture
def parts(toy: Toy) -> Toy:
    """The toy, whose stage `scale` is made of parts, one a video; it has run."""
    toy.split()
    assert toy.imocap(["run", "toy"]) == 0
    assert toy.ran() == ["gather", "scale", "part_v1", "part_v2", "evaluate"]
    return toy


def test_a_changed_video_is_the_only_part_that_is_made(parts: Toy) -> None:
    (parts.action / "v2.txt").write_text("7")
    assert parts.imocap(["run", "toy"]) == 0
    assert parts.ran() == ["gather", "scale", "part_v2", "evaluate"]


def test_another_action_finds_the_part_of_a_video_that_it_has(parts: Toy) -> None:
    other = parts.root / "actions" / "other"
    other.mkdir()
    (other / "action.yaml").write_text(ACTION.replace("toy", "other").replace("v1", "side"))
    (other / "side.txt").write_text((parts.action / "v1.txt").read_text())
    (other / "v2.txt").write_text("11")
    assert parts.imocap(["run", "other"]) == 0
    assert parts.ran() == ["gather", "scale", "part_v2", "evaluate"]


@pytest.mark.parametrize(
    "words", [["--set", "sync.method=als"], ["--force"], ["--set", "sync.max_rate=7"]]
)
def test_a_parameter_of_the_stage_or_force_makes_all_parts(parts: Toy, words: list[str]) -> None:
    assert parts.imocap(["run", "toy", *words]) == 0
    assert [name for name in parts.ran() if "part" in name] == ["part_v1", "part_v2"]


def test_a_damaged_part_is_made_again(parts: Toy) -> None:
    before = parts.digests()
    for file in (parts.root / "artifacts" / ".cache" / "scale_value").iterdir():
        file.write_bytes(file.read_bytes()[:-40])
    for file in (parts.root / "artifacts").glob("**/scale/*.mcap"):
        file.unlink()
    (parts.root / "artifacts" / "toy" / "scale.mcap").unlink()
    assert parts.imocap(["run", "toy"]) == 0
    assert parts.ran() == ["scale", "part_v1", "part_v2"]
    assert parts.digests() == before


def test_parts_are_tasks_of_their_own(parts: Toy, capsys: pytest.CaptureFixture[str]) -> None:
    before = parts.digests()
    shutil.rmtree(parts.root / "artifacts")
    capsys.readouterr()
    assert parts.imocap(["run-all", "toy", "--executor", "serial", "--json"]) == 0
    assert parts.ran() == ["gather", "part_v1", "part_v2", "scale", "evaluate"]
    assert parts.digests() == before


def test_a_fault_of_a_part_is_that_of_its_stage(parts, capsys, monkeypatch):
    shutil.rmtree(parts.root / "artifacts")
    monkeypatch.setenv("TOY_PART_V2", "bad")
    assert parts.imocap(["run-all", "toy", "--executor", "serial"]) == 1
    assert "scale: keypoints/v1: expected numbers, got [nonsense]" in capsys.readouterr().out
    assert parts.ran() == ["gather", "part_v1", "part_v2"]
