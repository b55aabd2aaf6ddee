"""Tables of a benchmark, their place in the documentation, and `make measure`."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from benchmarks import docs, measure, motion, parallel, scoring, tables
from benchmarks.measure import PLAN, PYTHON, Measurement
from benchmarks.names import BenchmarkName, report_of
from benchmarks.tables import DETAILS
from imocap_core.artifacts.store import Stored
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Outcome
from tests.benchmarks.tasks import halve
from tests.benchmarks.test_motion import Silent

ROOT = Path(__file__).resolve().parents[2]


def made_score(action: str, loop: float) -> scoring.ActionScore:
    numbers = {
        name: {"mpjpe_scaled_mm": value, "pa_mpjpe_mm": value / 2, "sync_error_pct": 0.5}
        for name, value in zip(scoring.RESULTS, (110.0, 70.0, 50.0, loop, 30.0), strict=True)
    }
    return scoring.ActionScore(action, 4, 300, numbers, {"sync": scoring.Cost(60.0, 1.0)}, "key")


def test_the_share_of_the_gap() -> None:
    assert tables.gap_closed(70, 50, 30) == 50
    assert tables.gap_closed(70, 70, 30) == 0
    assert tables.gap_closed(70, 80, 30) == -25
    assert np.isnan(tables.gap_closed(30, 30, 30))
    assert np.isnan(tables.gap_closed(None, 30, 20))


def test_mean_and_standard_error() -> None:
    assert tables.mean_and_error([1.0, 2.0, 3.0]) == pytest.approx((2.0, 1 / np.sqrt(3)))
    assert np.isnan(tables.mean_and_error([1.0])[1])


def test_the_tables_hold_every_action_its_means_and_the_paper() -> None:
    scores = [made_score("jump", 50.0), made_score("walk", 40.0)]
    benchmark = motion.MotionBenchmark("Title", "imocap benchmark x", "data", "fine_tuned", scores)
    text = motion.markdown(benchmark)
    assert "| jump | 110.0 | 70.0 | 50.0 | 50.0 | 30.0 | 50 |" in text
    assert "| 4 videos | after loop | 66.53 | 45.0 ± 5.0 | 50.33 | 22.5 ± 2.5 |" in text
    assert "`imocap benchmark x`" in text
    assert "jump,after loop,mpjpe_scaled_mm,50.0" in motion.csv_text(benchmark)
    numbers = json.loads(motion.json_text(benchmark))
    assert numbers["means"]["after loop"]["mpjpe_scaled_mm"]["mean"] == 45.0


# --- docs


PAGE = """# Page

<!-- table trials-4v -->
old
<!-- end -->

<!-- table trials -->
stays
<!-- end -->
"""


def test_a_table_takes_its_block_and_no_other() -> None:
    page = docs.replaced(PAGE, "trials-4v", "## New\n\n| a |")
    assert "<!-- table trials-4v -->\n\n## New\n\n| a |\n\n<!-- end -->" in page
    assert "old" not in page
    assert "<!-- table trials -->\nstays\n<!-- end -->" in page
    assert docs.replaced(page, "trials-4v", "## New\n\n| a |") == page
    assert docs.replaced(PAGE, "protocol", "x") == PAGE


def test_every_page_with_the_marks_gets_the_table(tmp_path: Path) -> None:
    pages = [tmp_path / page for page in docs.PAGES[:2]]
    pages[0].parent.mkdir(parents=True)
    pages[0].write_text(PAGE)
    pages[1].write_text("# No marks\n")
    tables = {"trials": docs.essentials(f"# T\n\n| a |\n{DETAILS}\nmore\n")}
    assert docs.stale(tmp_path, tables) == [docs.PAGES[0]]
    docs.put(tmp_path, tables)
    assert "-->\n\n| a |\n\n<!-- end -->" in pages[0].read_text()
    assert pages[1].read_text() == "# No marks\n"
    assert docs.stale(tmp_path, tables) == []


MEASURED = """<!-- table trials-fine_tuned-4v -->
| action | monocular | single pass | after loop | oracle | gap closed % | sync %, after loop |
| --- | --- | --- | --- | --- | --- | --- |
| jump | 40.0 | 1 | 2 | 3 | 4 | 5 |
| **mean** | 49.8 ± 2.3 | 27.3 ± 2 | 27.1 ± 1.9 | 25.7 ± 1.7 | 94 | 3.39 ± 1.15 |
<!-- end -->
<!-- table field -->
| set | right | of |
| --- | --- | --- |
| all | 31 | 35 |
<!-- end -->
"""


def test_the_front_page_s_figures_are_those_of_the_measured_tables() -> None:
    (row,) = (line for line in docs.summary(MEASURED).splitlines() if "`trials`" in line)
    assert row.endswith("| 49.8 | 27.3 | 27.1 | 25.7 | 94 | – | 3.39 | – |")
    front = docs.headline(MEASURED)
    assert "| 49.8 | 27.1 | 25.7 | – | 3.39 |" in front
    assert "| the paper, on Human3.6M | 80.7 | 66.5 |" in front
    assert "Of 35 known facts of real exercises and throws 31 come out right" in front
    assert "balance_beam" not in front  # not measured there


def test_the_pages_say_what_is_derived_from_their_tables() -> None:
    assert docs.stale(ROOT, {}) == [], "python -m benchmarks.measure --write"


def test_every_name_has_its_measurement() -> None:
    names = get_args(BenchmarkName)
    assert all(callable(report_of(name)) for name in names)
    readme = (ROOT / "benchmarks" / "README.md").read_text()
    rows = [line.split("`")[1] for line in readme.splitlines() if line.startswith("| `")]
    assert sorted(rows) == sorted(names)


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_ends_and_a_fault_stops_no_other(jobs: int) -> None:
    tasks = [(f"t{n}", (n,)) for n in (2, 3, 4)]
    ended = {e.name: e for e in parallel.each(halve, tasks, jobs, Silent())}
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
        list(parallel.each(stop, [(f"t{n}", (n,)) for n in range(3)], 1, Silent()))


def outcome(how: str) -> Outcome:
    class Kept(Stored):
        key = "k"  # type: ignore[assignment]

    stored = Kept.__new__(Kept)
    return Outcome("sync", how, stored, 1.0)  # type: ignore[arg-type]


def test_a_meter_keeps_the_cost_of_what_was_made(tmp_path: Path) -> None:
    meter = scoring.Meter(Silent(), tmp_path / "costs")
    assert meter.costs([outcome("cached")]) == {}
    meter.started("sync", [])
    meter.finished(outcome("made"))
    cost = meter.costs([outcome("cached")])["sync"]
    assert 0 <= cost.seconds < 5
    assert 0 < cost.peak_gb < 100


def test_the_peak_falls_when_it_is_reset() -> None:
    held = bytearray(os.urandom(1) * (200 << 20))
    high = scoring.peak_gb()
    del held
    scoring.reset_peak()
    if Path("/proc/self/clear_refs").exists():
        assert scoring.peak_gb() < high - 0.1


WRITE = "open('made.md', 'a').write('# Title\\n\\n| a |\\n')"


@pytest.fixture
def writes() -> Measurement:
    return Measurement("made", (PYTHON, "-c", WRITE), made="made.md")


def test_a_command_leaves_its_record_and_table(tmp_path: Path, writes: Measurement) -> None:
    (tmp_path / "made.md").write_text("of an earlier run")
    record = measure.run(writes, tmp_path / "records", root=tmp_path)
    assert (record.outcome, record.reason) == ("done", "")
    assert record == measure.record_of(tmp_path / "records", "made")
    assert (tmp_path / "records" / "made.md").read_text() == "| a |"


def test_what_fails_or_lacks_its_data_says_why(tmp_path, writes, monkeypatch):
    monkeypatch.setenv("IMOCAP_DATA", str(tmp_path))
    failed = measure.run(replace(writes, command=(PYTHON, "-c", "1/0")), tmp_path, root=tmp_path)
    assert failed.outcome == "failed"
    assert "ZeroDivisionError" in (tmp_path / "made.log").read_text()
    nothing = measure.run(replace(writes, command=(PYTHON, "-c", "1")), tmp_path, root=tmp_path)
    assert nothing.outcome == "failed"  # ended well, and left no table
    skipped = measure.run(replace(writes, data=("trials",)), tmp_path, root=tmp_path)
    assert skipped.outcome == "skipped"
    assert f"{tmp_path}/trials does not exist" in skipped.reason


def test_only_what_is_not_done_runs_again(tmp_path, writes, monkeypatch, capsys):
    monkeypatch.setattr(measure, "ROOT", tmp_path)
    ran = []

    def run(measurement: Measurement, folder: Path, jobs: int) -> measure.Record:
        ran.append(measurement.table)
        outcome = "failed" if measurement.table == "b" else "done"
        record = measure.Record(measurement.table, "x", "c", "2026-01-01 00:00", 1.0, outcome)
        folder.mkdir(exist_ok=True)
        (folder / f"{record.table}.json").write_text(json.dumps(record.__dict__))
        (folder / f"{record.table}.md").write_text("")
        return record

    monkeypatch.setattr(measure, "run", run)
    chosen = [replace(writes, table=name) for name in "abc"]
    assert measure.measure(chosen, tmp_path / "code", 1) == 1
    assert measure.measure(chosen, tmp_path / "code", 1) == 1
    assert ran == ["a", "b", "c", "b"]
    assert "[2/3] b: failed in 1 s" in capsys.readouterr().out


def test_every_measured_table_has_its_place_and_no_other_has() -> None:
    pages = "".join((ROOT / page).read_text() for page in docs.PAGES)
    names = {line[11:-4] for line in pages.splitlines() if line.startswith("<!-- table ")}
    assert names == {m.table for m in PLAN} | {measure.SUMMARY, "summary", "headline"}


def test_robustness_is_counted_from_its_records() -> None:
    fuzzed = json.dumps({"became": {"a": {"read": 1200, "Hung": 2}, "b": {"refused": 3}}})
    assert measure.fuzz_table(fuzzed).endswith("| damaged files of 2 readers | 1,205 | 2 |")
    chaos = json.dumps({"full disk": {"tried": 13, "lost": 0}})
    assert measure.chaos_table(chaos).endswith("| full disk | 13 | 0 |")
