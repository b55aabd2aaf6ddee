"""Tasks one after the other or in processes of their own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from benchmarks.parallel import ActionDisplay, each
from benchmarks.scoring.costs import Meter, peak_gb, reset_peak
from imocap_core.artifacts.store import Stored
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Outcome


class Recording:
    """A display that remembers."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def started(self, stage: str, why: list[str]) -> None:
        self.lines.append(f"{stage} {why}")

    def progress(self, share: float, what: str) -> None:
        self.lines.append(what)

    def finished(self, outcome: Outcome) -> None:
        self.lines.append(f"{outcome.stage} {outcome.how}")

    def made_demo(self, name: str, folder: Path) -> None:
        self.lines.append(name)

    def waiting(self) -> None:
        self.lines.append("waiting")

    def notice(self, sentence: str) -> None:
        self.lines.append(sentence)


def halve(display: object, number: int) -> tuple[int, str, int]:
    if number % 2:
        raise WorkFailed(f"{number} is odd")
    return number // 2, os.environ.get("OMP_NUM_THREADS", ""), os.getpid()


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_ends_and_a_fault_stops_no_other(jobs: int) -> None:
    tasks = [(f"t{n}", (n,)) for n in (2, 3, 4)]
    ended = {e.name: e for e in each(halve, tasks, jobs, Recording())}
    assert ended["t3"].result is None
    assert ended["t3"].fault == "3 is odd"
    made = [ended[name].result for name in ("t2", "t4")]
    assert [m[0] for m in made if m is not None] == [1, 2]
    if jobs == 2:
        assert all(m is not None and m[1] == "1" and m[2] != os.getpid() for m in made)


def stop(display: object, number: int) -> int:
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt:
        raise WorkFailed("stopped") from None


def test_the_user_stops_everything() -> None:
    with pytest.raises(WorkFailed, match="stopped"):
        list(each(stop, [(f"t{n}", (n,)) for n in range(3)], 1, Recording()))


def outcome(how: str) -> Outcome:
    class Kept(Stored):
        key = "k"  # type: ignore[assignment]

    stored = Kept.__new__(Kept)
    return Outcome("sync", how, stored, 1.0)  # type: ignore[arg-type]


def test_a_named_display_says_whose_stage_it_is_and_leaves_out_what_is_cached() -> None:
    display = Recording()
    named = ActionDisplay(display, "walk, rank_2")
    named.started("sync", ["never run", "other"])
    named.finished(outcome("cached"))
    named.finished(outcome("made"))
    assert display.lines == ["sync ['walk, rank_2: never run', 'other']", "sync made"]


def test_a_meter_keeps_the_cost_of_what_was_made(tmp_path: Path) -> None:
    meter = Meter(Recording(), tmp_path / "costs")
    assert meter.costs([outcome("cached")]) == {}
    meter.started("sync", [])
    meter.finished(outcome("made"))
    cost = meter.costs([outcome("cached")])["sync"]
    assert 0 <= cost.seconds < 5
    assert 0 < cost.peak_gb < 100


def test_the_peak_falls_when_it_is_reset() -> None:
    held = bytearray(os.urandom(1) * (200 << 20))
    high = peak_gb()
    del held
    reset_peak()
    if Path("/proc/self/clear_refs").exists():
        assert peak_gb() < high - 0.1
