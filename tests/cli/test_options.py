"""`--device`: checked before anything runs, handed to every worker, no part of a result."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from imocap_core.cli.options import plain
from tests.pipeline.conftest import Toy

Capture = pytest.CaptureFixture[str]


def with_cards(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)


@pytest.mark.parametrize("command", [["run"], ["stage", "scale"], ["run-all"]])
def test_a_device_that_is_not_there_is_a_sentence_before_anything_runs(
    toy, monkeypatch, capsys, command
):
    with_cards(monkeypatch, 0)
    assert toy.imocap([*command, "toy", "--device", "cuda"]) == 2
    message = capsys.readouterr().err
    assert message.startswith("imocap: device cuda: PyTorch finds no CUDA device here")
    assert message.count("\n") == 1
    assert toy.imocap([*command, "toy", "--device", "gpu"]) == 2
    assert "expected cpu, cuda or cuda:1, got 'gpu'" in capsys.readouterr().err
    assert toy.ran() == []


def test_the_number_of_a_device_must_be_there(toy, monkeypatch, capsys):
    with_cards(monkeypatch, 2)
    assert toy.imocap(["run", "toy", "--device", "cuda:2"]) == 2
    assert "PyTorch finds CUDA devices cuda:0 to cuda:1 here" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["run"], ["run-all", "--executor", "serial"]])
def test_results_are_not_made_again_for_another_device(toy, monkeypatch, command):
    with_cards(monkeypatch, 2)
    monkeypatch.setenv("IMOCAP_DEVICE", "cuda:1")
    assert toy.imocap([*command, "toy"]) == 0
    assert len(toy.ran()) == 3
    record = toy.root / "artifacts" / "toy" / "run.json"
    assert json.loads(record.read_text())["device"] == "cuda:1"
    assert toy.imocap([*command, "toy", "--device", "cpu"]) == 0
    assert toy.ran() == []
    assert json.loads(record.read_text())["device"] == "cpu"


def document(toy: Toy, capsys: Capture, *words: str, code: int = 0) -> Any:
    capsys.readouterr()
    assert toy.imocap([*words, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_status(toy: Toy, capsys: Capture) -> None:
    rows = document(toy, capsys, "status", "toy")["stages"]
    assert rows[0] == {
        "stage": "gather", "state": "would run", "why": ["never run"], "digest": None,
    }  # fmt: skip
    toy.imocap(["run", "toy"])
    state = document(toy, capsys, "status", "toy")
    assert state["action"] == "toy"
    assert {row["stage"]: row["digest"] for row in state["stages"]} == toy.digests()
    assert {row["state"] for row in state["stages"]} == {"cached"}


def test_run(toy: Toy, capsys: Capture) -> None:
    first = document(toy, capsys, "run", "toy")
    assert [(row["stage"], row["how"]) for row in first["stages"]] == [
        ("gather", "made"), ("scale", "made"), ("evaluate", "made"),
    ]  # fmt: skip
    assert {row["stage"]: row["digest"] for row in first["stages"]} == toy.digests()
    again = document(toy, capsys, "run", "toy")
    assert {row["how"] for row in again["stages"]} == {"cached"}
    # a pipeline without these results says so
    assert [again[name] for name in ("trusted", "sync", "cameras", "verdict")] == [None] * 4


@pytest.mark.parametrize(
    ("words", "code", "fault"),
    [(["run", "toy"], 1, "expected numbers"), (["status", "nobody"], 2, "nobody")],
)
def test_what_fails_leaves_the_standard_output_empty(toy, capsys, monkeypatch, words, code, fault):
    monkeypatch.setenv("TOY_SCALE", "bad")
    assert toy.imocap([*words, "--json"]) == code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert fault in shown.err


def test_explain(toy: Toy, capsys: Capture) -> None:
    before = document(toy, capsys, "explain", "toy", "scale")
    assert before["missing"] == ["gather"]
    assert "key" not in before
    toy.imocap(["run", "toy"])
    after = document(toy, capsys, "explain", "toy", "scale")
    assert (after["state"], after["why"], after["seed"]) == ("cached", [], 7)
    assert after["inputs"] == {"gather": toy.digests()["gather"]}
    assert after["params"]["sync"]["method"] == "softmap"


def test_doctor_reports_a_fault_in_its_exit_code_too(toy, capsys):
    good = document(toy, capsys, "doctor")
    assert good["ok"] is True
    assert all(check["works"] for check in good["checks"])
    (toy.root / "pipeline.yaml").write_text("seed: x\n")
    bad = document(toy, capsys, "doctor", code=1)
    assert bad["ok"] is False
    assert sum(not check["works"] for check in bad["checks"]) == 1


def test_values_become_json_s_types():
    @dataclass
    class Row:
        file: Path
        values: tuple[float, ...]

    row = Row(Path("a/b"), (1.5, float("nan"), np.float64(2.0), np.int64(3)))
    assert plain({"row": row}) == {"row": {"file": "a/b", "values": [1.5, None, 2.0, 3]}}
