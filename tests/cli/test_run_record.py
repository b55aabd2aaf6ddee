"""Every run leaves a record for programs: what it did, under which settings, and how it ended."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from imocap_core import process
from imocap_core.version import __version__
from tests.pipeline.conftest import Toy


def record(toy: Toy) -> dict[str, Any]:
    return json.loads((toy.root / "artifacts" / "toy" / "run.json").read_text())


def test_a_run_is_recorded(toy: Toy) -> None:
    assert toy.imocap(["run", "toy"]) == 0
    first = record(toy)
    assert (first["status"], first["error"]) == ("done", None)
    assert first["versions"]["imocap"] == __version__
    assert [stage["how"] for stage in first["stages"]] == ["made"] * 3
    assert all(stage["peak_bytes"] > 2**20 for stage in first["stages"])
    assert first["params"]
    assert toy.imocap(["run", "toy"]) == 0
    second = record(toy)
    assert [stage["how"] for stage in second["stages"]] == ["cached"] * 3
    assert [s["digest"] for s in second["stages"]] == [s["digest"] for s in first["stages"]]


def test_a_failed_run_is_recorded(toy: Toy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOY_SCALE", "bad")
    assert toy.imocap(["run", "toy"]) == 1
    failed = record(toy)
    assert failed["status"] == "failed"
    assert failed["error"] == "scale: keypoints/v1: expected numbers, got [nonsense]"
    assert [stage["stage"] for stage in failed["stages"]] == ["gather"]


@pytest.mark.skipif(not process.CLEAR.exists(), reason="no /proc")
def test_peak_memory_is_that_since_the_restart() -> None:
    numbers = np.ones(2**25)
    before = process.peak_bytes()
    assert before is not None
    assert before > numbers.nbytes
    del numbers
    process.restart_peak()
    after = process.peak_bytes()
    assert after is not None
    assert after < before - 2**27
