"""What has not changed is not made again, nor are parts of results; what is wrong is said in a
sentence."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from imocap_core.artifacts.store import Store
from imocap_core.library.api_errors import displaying
from imocap_core.pipeline.runner import Outcome, run
from imocap_core.workspace import Workspace
from tests.pipeline.conftest import ACTION, Toy

ALL = ["gather", "scale", "evaluate"]


def test_a_second_run_makes_nothing(toy: Toy, capsys: pytest.CaptureFixture[str]) -> None:
    assert toy.imocap(["run", "toy"]) == 0
    assert toy.ran() == ALL
    before = toy.digests()
    capsys.readouterr()
    assert toy.imocap(["run", "toy"]) == 0
    assert toy.ran() == []
    assert toy.digests() == before
    assert "toy: 3 stages, all cached" in capsys.readouterr().out


def test_a_parameter_reruns_its_stage_and_what_follows(toy: Toy) -> None:
    toy.imocap(["run", "toy"])
    before = toy.digests()
    toy.ran()
    assert toy.imocap(["run", "toy", "--set", "sync.method=als"]) == 0
    assert toy.ran() == ["scale", "evaluate"]
    assert toy.digests()["gather"] == before["gather"]
    assert toy.digests()["scale"] != before["scale"]


def test_going_back_costs_nothing(toy: Toy) -> None:
    toy.imocap(["run", "toy"])
    before = toy.digests()
    toy.imocap(["run", "toy", "--set", "sync.method=als"])
    toy.ran()
    toy.imocap(["run", "toy"])
    assert toy.ran() == []
    assert toy.digests() == before


def test_equal_content_stops_a_change_from_spreading(toy: Toy) -> None:
    toy.imocap(["run", "toy"])
    toy.ran()
    assert toy.imocap(["run", "toy", "--set", "sync.method=svt"]) == 0
    assert toy.ran() == ["scale"]  # svt scales as softmap does, so evaluate has the same input


def test_time_and_place_of_the_files_don_t_matter(toy: Toy, tmp_path: Path) -> None:
    toy.imocap(["run", "toy"])
    before = toy.digests()
    toy.ran()
    elsewhere = tmp_path / "moved" / "toy"
    shutil.copytree(toy.action, elsewhere)
    assert toy.imocap(["run", str(elsewhere)]) == 0
    assert toy.ran() == []
    assert toy.digests() == before


def test_the_same_seed_gives_the_same_digests(toy: Toy) -> None:
    toy.imocap(["run", "toy"])
    before = toy.digests()
    shutil.rmtree(toy.root / "artifacts")
    toy.imocap(["run", "toy"])
    assert toy.digests() == before
    toy.imocap(["run", "toy", "--set", "seed=8"])
    assert toy.digests()["gather"] != before["gather"]


def test_force_runs_what_is_cached(toy: Toy) -> None:
    toy.imocap(["run", "toy"])
    toy.ran()
    assert toy.imocap(["stage", "scale", "toy", "--force"]) == 0
    assert toy.ran() == ["scale"]
    assert toy.imocap(["run", "toy", "--force"]) == 0
    assert toy.ran() == ALL


def test_one_stage_brings_what_it_needs(toy: Toy) -> None:
    assert toy.imocap(["stage", "scale", "toy"]) == 0
    assert toy.ran() == ["gather", "scale"]
    assert toy.imocap(["run", "toy", "--until", "scale"]) == 0
    assert toy.ran() == []


@pytest.mark.parametrize("stage", ALL)
@pytest.mark.parametrize("remembered", [False, True])
def test_a_damaged_artifact_is_made_again(toy: Toy, stage: str, remembered: bool) -> None:
    toy.imocap(["run", "toy"])
    if remembered:
        aged(toy)
        toy.imocap(["run", "toy"])
    before = toy.digests()
    toy.ran()
    file = Store(toy.root / "artifacts").current("toy", stage)
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    assert toy.imocap(["run", "toy"]) == 0
    assert toy.ran() == [stage]
    assert toy.digests() == before


def test_a_lost_report_comes_back(toy: Toy) -> None:
    toy.imocap(["run", "toy"])
    toy.ran()
    shutil.rmtree(toy.root / "artifacts" / "toy" / "report")
    toy.imocap(["run", "toy"])
    assert toy.ran() == []
    assert (toy.root / "artifacts" / "toy" / "report" / "index.md").is_file()


def test_a_killed_run_continues_and_what_it_left_is_swept(toy: Toy) -> None:
    folder = toy.root / "artifacts"
    assert toy.apart("run", "toy", TOY_SCALE="kill")[0] == -signal.SIGKILL
    assert toy.ran() == ["gather", "scale"]
    assert [p.name[:7] for p in (folder / "toy").glob(".stage-*")] == [".stage-"]
    assert toy.imocap(["run", "toy"]) == 0
    assert toy.ran() == ["scale", "evaluate"]
    assert list(folder.rglob("*.part")) == list((folder / "toy").glob(".stage-*")) == []


@pytest.mark.long
def test_two_runs_of_one_action_don_t_meet(toy: Toy) -> None:
    store = Store(toy.root / "artifacts")
    command = [sys.executable, "-m", "stages", "run", "toy", "--root", str(toy.root)]
    with store.lock("toy", lambda: None):
        second = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        said = second.stdout.readline()
        assert toy.ran() == []
    out, _ = second.communicate(timeout=300)
    assert "another run of this action is at work" in said
    assert "toy: 3 stages, 3 made" in out


@pytest.mark.parametrize("restored", [True, False])
def test_an_input_that_changes_while_it_is_read_gives_no_result(toy, monkeypatch, capsys, restored):
    monkeypatch.setenv("TOY_GATHER", "restored" if restored else "changed")
    assert toy.imocap(["run", "toy"]) == 1
    error = capsys.readouterr().err
    assert f"{toy.action / 'v1.txt'} (detections v1) was changed while it was read" in error
    assert toy.digests() == {}
    (toy.action / "v1.txt").write_text("1.5")
    monkeypatch.delenv("TOY_GATHER")
    assert toy.imocap(["run", "toy"]) == 0
    undisturbed = toy.digests()
    shutil.rmtree(toy.root / "artifacts")
    assert toy.imocap(["run", "toy"]) == 0
    assert toy.digests() == undisturbed


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_a_run_with_its_exit_code_and_leaves_nothing(toy, number, code):
    stopped = "imocap: stopped; finished stages are stored, run again to continue\n"
    assert toy.apart("run", "toy", TOY_SCALE=f"signal {number.value}") == (code, stopped)
    folder = toy.root / "artifacts"
    hidden = {p.name for p in folder.rglob(".*")} - {".cache", ".lock"}
    assert hidden == set()
    assert set(toy.digests()) == {"gather"}


def test_a_report_that_was_being_replaced_is_put_back_with_what_people_put_there(toy: Toy) -> None:
    toy.imocap(["run", "toy"])
    folder = toy.root / "artifacts" / "toy"
    (folder / "report" / "notes.txt").write_text("mine")
    (folder / "report").rename(folder / ".report-x-old")  # killed between two renames
    (folder / ".report-x").mkdir()
    assert toy.imocap(["run", "toy"]) == 0
    assert (folder / "report" / "notes.txt").read_text() == "mine"
    assert [p.name for p in folder.glob(".report*")] == []


def test_what_is_cached_can_be_read_on_a_disk_that_can_not_be_written(toy, monkeypatch, capsys):
    assert toy.imocap(["run", "toy"]) == 0
    before = toy.digests()
    really_open, folder = Path.open, toy.root / "artifacts"

    def read_only(path: Path, mode: str = "r", *rest: object, **named: object) -> object:
        if path.is_relative_to(folder) and mode.strip("rb"):
            raise OSError(errno.EROFS, "Read-only file system", str(path))
        return really_open(path, mode, *rest, **named)  # type: ignore[arg-type,call-overload]

    def no_draft(*words: object, **named: object) -> object:
        raise OSError(errno.EROFS, "Read-only file system", str(folder))

    monkeypatch.setattr(Path, "open", read_only)
    monkeypatch.setattr("tempfile.mkstemp", no_draft)
    monkeypatch.setattr("tempfile.mkdtemp", no_draft)
    capsys.readouterr()
    assert toy.imocap(["run", "toy"]) == 0
    assert "all cached" in capsys.readouterr().out
    assert toy.digests() == before
    assert toy.imocap(["run", "toy", "--force"]) == 1
    assert "cannot use" in (error := capsys.readouterr().err)
    assert "Read-only file system" in error


def test_a_run_has_its_action_until_its_report_is_written(toy: Toy) -> None:
    job = Workspace(toy.root).job("toy", [])
    waited = []

    def second_run() -> None:
        waited.append(True)
        raise TimeoutError

    def report(outcomes: list[Outcome]) -> None:
        with pytest.raises(TimeoutError), job.store.lock("toy", second_run):
            pass

    with displaying(None) as display:
        run(job, display, ALL, ending=report)
    assert waited == [True]
    with job.store.lock("toy", second_run):
        pass


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("bad", "imocap: scale: keypoints/v1: expected numbers, got [nonsense]\n"),
        ("bug", "imocap: scale broke: KeyError: 'x'. This is a fault of the program"),
        ("truth", "pipeline.yaml: stages.scale.reads: expected truth among them"),
    ],
)
def test_a_failed_stage_says_why(toy, monkeypatch, capsys, how, said):
    monkeypatch.setenv("TOY_SCALE", how)
    assert toy.imocap(["run", "toy"]) == 1
    shown = capsys.readouterr()
    assert said in shown.err
    assert "Traceback" not in shown.err
    assert set(toy.digests()) == {"gather"}
    assert toy.imocap(["run", "toy", "--traceback"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_nothing_before_evaluate_depends_on_the_truth(toy: Toy) -> None:
    action = toy.action / "action.yaml"
    action.write_text(action.read_text() + "truth: truth.npz\n")
    np.savez(toy.action / "truth.npz", sum=4.0)
    assert toy.imocap(["run", "toy"]) == 0
    before = toy.digests()
    toy.ran()
    (toy.action / "truth.npz").write_bytes(b"garbage")
    assert toy.imocap(["run", "toy"]) == 1
    assert toy.ran() == ["evaluate"]
    shutil.rmtree(toy.root / "artifacts")
    assert toy.imocap(["run", "toy"]) == 1
    assert toy.digests() == {name: before[name] for name in ("gather", "scale")}


def aged(toy: Toy) -> None:
    """What has just been written is read again; this is older."""
    for path in toy.root.rglob("*"):
        os.utime(path, (1_600_000_000, 1_600_000_000))


HEAVY = "torch cv2 scipy matplotlib av numpy jaxtyping mcap"


@pytest.mark.parametrize("command", ["run", "status"])
def test_what_is_cached_imports_nothing_heavy(toy: Toy, command: str) -> None:
    toy.imocap(["run", "toy"])
    code = (
        "import sys; from imocap_core.cli import main; code = main([]); "
        f"print(sorted(set('{HEAVY}'.split()) & set(sys.modules))); sys.exit(code)"
    )
    words = [command, "toy", "--root", str(toy.root)]
    aged(toy)
    assert toy.imocap(words[:2]) == 0
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"


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
