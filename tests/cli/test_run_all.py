"""`imocap run-all`: many actions, in sequence, in processes, on a cluster: the same results."""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
from collections import Counter

import pytest

from imocap_core.artifacts.store import Store
from tests.pipeline.conftest import Toy

Capture = pytest.CaptureFixture[str]
HAS_DASK = importlib.util.find_spec("distributed") is not None
NAMES = ("one", "three", "two")


def more_actions(toy: Toy) -> None:
    """Three actions of different numbers beside the toy's own, which goes."""
    for number, name in enumerate(NAMES):
        folder = toy.root / "actions" / name
        folder.mkdir()
        text = (toy.action / "action.yaml").read_text()
        (folder / "action.yaml").write_text(text.replace("name: toy", f"name: {name}"))
        (folder / "v1.txt").write_text(str(number))
        (folder / "v2.txt").write_text("5")
    for file in toy.action.iterdir():
        file.unlink()
    toy.action.rmdir()


def digests(toy: Toy) -> dict[tuple[str, str], str]:
    store = Store(toy.root / "artifacts")
    stored = {(a, s): store.load(a, s) for a in NAMES for s in ("gather", "scale", "evaluate")}
    return {place: result.digest for place, result in stored.items() if result is not None}


def run_all(toy: Toy, capsys: Capture, *words: str) -> tuple[int, dict]:
    capsys.readouterr()
    code = toy.imocap(["run-all", *words, "--json"])
    out, err = capsys.readouterr()
    assert out, err
    return code, {end["action"]: end for end in json.loads(out)["actions"]}


EXECUTORS = [
    ["processes", "--workers", "2"],
    pytest.param(
        ["dask", "--workers", "2"],
        marks=pytest.mark.skipif(not HAS_DASK, reason="the extra dask is not installed"),
    ),
]


@pytest.mark.parametrize("executor", EXECUTORS)
@pytest.mark.long
def test_several_at_once_give_and_publish_what_single_runs_give_whatever_fails_beside_them(
    toy, capsys, executor
):
    more_actions(toy)
    toy.split()
    for name in ("wrong", "broken"):
        shutil.copytree(toy.root / "actions" / "two", toy.root / "actions" / name)
    (toy.root / "actions" / "broken" / "action.yaml").write_text("name: [")
    wrong = toy.root / "actions" / "wrong"
    (wrong / "v1.txt").write_text("no number")
    text = (wrong / "action.yaml").read_text()
    (wrong / "action.yaml").write_text(text.replace("name: two", "name: wrong"))
    code, ends = run_all(toy, capsys, "--all", "--executor", *executor)
    assert code == 1
    states = {name: end["state"] for name, end in ends.items()}
    assert states == {"broken": "failed", **dict.fromkeys(NAMES, "done"), "wrong": "failed"}
    assert ends["wrong"]["fault"].startswith("gather: could not convert string to float")
    assert "is not YAML" in ends["broken"]["fault"]
    together = digests(toy)
    assert len(together) == 9
    stages = [(s["stage"], s["how"]) for s in ends["two"]["stages"]]
    assert stages == [(s, "made") for s in ("gather", "scale", "evaluate")]
    ran = Counter(toy.ran())
    assert 1 <= ran.pop("part_v2") <= 3  # a task of its own; the videos are equal
    assert ran == {"gather": 4, "part_v1": 3, "scale": 3, "evaluate": 3}
    for name in NAMES:
        assert toy.imocap(["run", name]) == 0
    assert toy.ran() == []
    for name in NAMES:
        assert toy.imocap(["run", name, "--force"]) == 0
    assert digests(toy) == together


def test_the_terminal_has_a_line_for_each_action_and_the_faults_last(toy, capsys):
    more_actions(toy)
    (toy.root / "actions" / "one" / "v1.txt").write_text("no number")
    capsys.readouterr()
    assert toy.imocap(["run-all", "three", "one", "--executor", "serial"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:2] == ["done", "three"]
    assert lines[0].endswith("3 made, 0 cached")
    assert lines[1].split()[:2] == ["failed", "one"]
    assert "2 actions: 1 done, 1 failed." in lines
    assert lines[-1] == "What was finished is stored; run again to go on."


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="kills a process as Linux does")
def test_a_stage_that_kills_its_worker_is_tried_again_and_then_a_sentence(toy, capsys, monkeypatch):
    more_actions(toy)
    monkeypatch.setenv("TOY_SCALE", "kill")
    code, ends = run_all(toy, capsys, "two", "--workers", "1")
    assert code == 1
    assert ends["two"]["fault"].startswith("scale: its process was ended from outside (SIGKILL")
    assert toy.ran() == ["gather", "scale", "scale"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "expected actions, or --all"),
        (["one", "--all"], "expected actions, or --all"),
        (["one", "one"], "expected every action once, got one twice"),
        (["one", "--executor", "slurm"], "expected one of serial, processes, dask, got 'slurm'"),
        (["one", "--workers", "0"], "workers: expected 1 or more, got 0"),
        (["one", "--address", "a:1"], "the executor is processes"),
    ],
)
def test_wrong_use_is_said_before_anything_runs(toy, capsys, words, sentence):
    more_actions(toy)
    capsys.readouterr()
    assert toy.imocap(["run-all", *words]) == 2
    assert sentence in capsys.readouterr().err
    assert toy.ran() == []


def test_all_of_an_empty_folder_names_what_to_do(toy: Toy, capsys: Capture) -> None:
    for file in toy.action.iterdir():
        file.unlink()
    toy.action.rmdir()
    assert toy.imocap(["run-all", "--all"]) == 2
    assert "imocap init NAME VIDEO" in capsys.readouterr().err
