"""`--device`: checked before anything runs, handed to every worker, no part of a result."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
import torch

if TYPE_CHECKING:
    from tests.pipeline.conftest import Toy

Capture = pytest.CaptureFixture[str]


def with_cards(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)


@pytest.mark.parametrize("command", [["run"], ["stage", "scale"], ["run-all"]])
def test_a_device_that_is_not_there_is_a_sentence_before_anything_runs(
    toy: Toy, monkeypatch: pytest.MonkeyPatch, capsys: Capture, command: list[str]
) -> None:
    with_cards(monkeypatch, 0)
    assert toy.imocap([*command, "toy", "--device", "cuda"]) == 2
    message = capsys.readouterr().err
    assert message.startswith("imocap: device cuda: PyTorch finds no CUDA device here")
    assert message.count("\n") == 1
    assert toy.imocap([*command, "toy", "--device", "gpu"]) == 2
    assert "expected cpu, cuda or cuda:1, got 'gpu'" in capsys.readouterr().err
    assert toy.ran() == []


def test_the_number_of_a_device_must_be_there(
    toy: Toy, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    with_cards(monkeypatch, 2)
    assert toy.imocap(["run", "toy", "--device", "cuda:2"]) == 2
    assert "PyTorch finds CUDA devices cuda:0 to cuda:1 here" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["run"], ["run-all", "--executor", "serial"]])
def test_results_are_not_made_again_for_another_device(
    toy: Toy, monkeypatch: pytest.MonkeyPatch, command: list[str]
) -> None:
    with_cards(monkeypatch, 2)
    monkeypatch.setenv("IMOCAP_DEVICE", "cuda:1")
    assert toy.imocap([*command, "toy"]) == 0
    assert len(toy.ran()) == 3
    record = toy.root / "artifacts" / "toy" / "run.json"
    assert json.loads(record.read_text())["device"] == "cuda:1"
    assert toy.imocap([*command, "toy", "--device", "cpu"]) == 0
    assert toy.ran() == []
    assert json.loads(record.read_text())["device"] == "cpu"
