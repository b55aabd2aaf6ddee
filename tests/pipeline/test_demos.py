"""A built-in action is made when it is absent, by older code, or not whole; yours never is."""

import importlib
import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from imocap_core.pipeline import builtin_actions as demos
from tests.processes import in_new_process


@pytest.fixture
def makes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The seeds that a stand-in for the demo was made with."""
    made: list[int] = []

    def make_demo(
        name: str, folder: Path, seed: int, progress: object, ending: Callable[[Path], None]
    ) -> None:
        made.append(seed)
        (folder / "videos").mkdir(parents=True, exist_ok=True)
        (folder / "action.yaml").write_text(f"name: {name}")
        (folder / "videos" / "v1.mp4").write_text(str(seed))
        ending(folder)

    stand_in = ModuleType("imocap_core.pipeline.make_demo")
    stand_in.make_demo = make_demo  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "imocap_core.pipeline.make_demo", stand_in)
    return made


@pytest.fixture
def display() -> SimpleNamespace:
    quiet = lambda *said: None  # noqa: E731
    return SimpleNamespace(started=quiet, progress=quiet, made_demo=quiet)


def test_made_once(tmp_path: Path, makes: list[int], display: SimpleNamespace) -> None:
    for _ in range(2):
        demos.ensure("yoga", tmp_path / "yoga", 7, display)
    assert makes == [7]


def test_made_again_when_needed(tmp_path: Path, makes: list[int], display: SimpleNamespace) -> None:
    folder = tmp_path / "yoga"
    demos.ensure("yoga", folder, 7, display)
    (folder / "videos" / "v1.mp4").unlink()
    demos.ensure("yoga", folder, 7, display)
    demos.ensure("yoga", folder, 8, display)
    for damaged in ("{", "[]", '{"files": 3}', '{"files": [[]]}', "[" * 100_000):
        (folder / demos.RECORD).write_text(damaged)
        demos.ensure("yoga", folder, 8, display)
    assert makes == [7, 7, *[8] * 6]


def test_an_own_action_stays(tmp_path: Path, makes: list[int], display: SimpleNamespace) -> None:
    folder = tmp_path / "yoga"
    folder.mkdir()
    (folder / "action.yaml").write_text("name: mine")
    demos.ensure("yoga", folder, 7, display)
    assert makes == []


@pytest.mark.parametrize("place", ["action.yaml", "videos/v1.mp4", "notes.txt"])
@pytest.mark.parametrize("record", ["as it is", "without digests", "damaged"])
def test_a_changed_demo_is_its_user_s(tmp_path, makes, display, place, record):
    folder = tmp_path / "yoga"
    demos.ensure("yoga", folder, 7, display)
    file = folder / demos.RECORD
    if record == "damaged":
        file.write_text("{")
    if record == "without digests":  # as older code wrote it
        content = json.loads(file.read_text())
        file.write_text(json.dumps({"key": content["key"], "files": list(content["files"])}))
    for name in ("action.yaml", "videos/v1.mp4", demos.RECORD):
        os.utime(folder / name, (1_600_000_000, 1_600_000_000))
    (folder / place).write_text("mine")
    reasons: list[str] = []
    display.started = lambda stage, why: reasons.extend(why)
    demos.ensure("yoga", folder, 8, display)
    assert makes == [7]
    assert (folder / place).read_text() == "mine"
    assert f"{place} in {folder} is yours, so it stays" in reasons[-1]


def make_and_die(folder: Path, moment: str) -> None:
    """In a process that is killed while it makes the demo, or while it puts it in its place."""
    make_demo = importlib.import_module("imocap_core.pipeline.make_demo")
    make_demo._write_videos = lambda name, seed, draft, progress: draft.mkdir() or {}
    rename = Path.rename

    def die(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    def renamed(path: Path, target: Path) -> None:
        die(rename(path, target))

    if moment == "replacing":
        Path.rename = renamed  # type: ignore[method-assign,assignment]
        make_demo.make_demo("yoga", folder, 7)
    make_demo.make_demo("yoga", folder, 7, None, die)


def drafts(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.parent.glob(".*"))


@pytest.mark.skipif(sys.platform == "win32", reason="processes are asked by signals")
@pytest.mark.parametrize("moment", ["making", "replacing"])
def test_the_draft_of_a_killed_process_is_swept(tmp_path, makes, display, moment):
    folder = tmp_path / "yoga"
    demos.ensure("yoga", folder, 7, display)
    assert in_new_process(make_and_die, folder, moment) == -signal.SIGKILL
    assert len(drafts(folder)) == 1
    assert folder.exists() == (moment == "making")
    ours = tmp_path / ".yoga.mine"
    ours.mkdir()
    demos.ensure("yoga", folder, 7, display)
    assert drafts(folder) == [ours.name]
    assert makes == [7]  # it was there all the time, or was put back
    assert (folder / "videos" / "v1.mp4").read_text() == "7"
