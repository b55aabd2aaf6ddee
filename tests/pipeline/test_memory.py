"""Freed memory is kept: the same arrays made again cost no new pages."""

from __future__ import annotations

import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest

from imocap_core.artifacts.schemas import Uncertainty
from imocap_core.artifacts.store import Store
from imocap_core.library.api_errors import displaying
from imocap_core.pipeline import runner
from imocap_core.pipeline.stage import Inputs
from imocap_core.process import keep_freed_memory
from imocap_core.workspace import Workspace
from tests.pipeline.conftest import Toy
from tests.report.made import Made

RELEASED = """
import numpy as np
from imocap_core.process import peak_bytes, restart_peak
from imocap_core.process import keep_freed_memory, release_freed_memory
keep_freed_memory()
arrays = [np.ones(100_000) for _ in range(200)]
del arrays
restart_peak()
before = peak_bytes()
release_freed_memory()
restart_peak()
print(before - peak_bytes())
"""
FAULTS = """
import resource, sys
import numpy as np
if sys.argv[1] == "kept":
    from imocap_core.process import keep_freed_memory
    assert keep_freed_memory()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(50):
    [np.ones(375_000) for _ in range(8)]
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems' libraries do it differently")
def test_arrays_made_again_cost_no_new_pages() -> None:
    def faults(how: str) -> int:
        done = subprocess.run(
            [sys.executable, "-c", FAULTS, how], capture_output=True, text=True, check=True
        )
        return int(done.stdout)

    assert faults("kept") < 0.2 * faults("given back")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems' libraries do it differently")
def test_freed_memory_is_given_back_between_stages() -> None:
    done = subprocess.run([sys.executable, "-c", RELEASED], capture_output=True, check=True)
    assert int(done.stdout) > 100_000_000


def test_an_input_is_held_by_its_stage_alone(tmp_path: Path) -> None:
    stored = Store(tmp_path).put("uncertainty", "key", Made().claimed, {}, {}).unread()
    inputs = Inputs("evaluate", {"uncertainty": stored})

    def held() -> weakref.ref[np.ndarray]:
        return weakref.ref(inputs.get(Uncertainty).videos[0].sigma_mm)

    first = held()
    assert inputs.get(Uncertainty).videos[0].sigma_mm is first()
    inputs.forget(Uncertainty)
    assert first() is None
    again = held()
    assert again() is not None
    del inputs
    assert again() is None
    assert "content" not in vars(stored)


def test_a_run_holds_no_contents(toy: Toy) -> None:
    job = Workspace(toy.root).job("toy", [])
    with displaying(None) as display:
        outcomes = runner.run(job, display, list(job.pipeline.stages))
    assert [outcome.how for outcome in outcomes] == ["made"] * 3
    for outcome in outcomes:
        assert outcome.stored._content is None
        assert "content" not in vars(outcome.stored)


def test_other_systems_are_left_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    assert not keep_freed_memory()
