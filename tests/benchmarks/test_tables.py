"""Tables of a benchmark, and their place in the documentation."""

import json
import os
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from benchmarks import docs, tables
from benchmarks.ablations import report as ablations_report
from benchmarks.motion import tables as motion_tables
from benchmarks.names import MEASUREMENTS, BenchmarkName, report_of
from benchmarks.parallel import each
from benchmarks.scoring.costs import Cost, Meter, peak_gb, reset_peak
from benchmarks.scoring.score_file import RESULTS, ActionScore
from imocap_core.artifacts.store import Stored
from imocap_core.cli import main
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Outcome
from tests.benchmarks.tasks import halve
from tests.benchmarks.test_motion import Silent

ROOT = Path(__file__).resolve().parents[2]


def made_score(action: str, loop: float) -> ActionScore:
    numbers = {
        name: {"mpjpe_scaled_mm": value, "pa_mpjpe_mm": value / 2, "sync_error_pct": 0.5}
        for name, value in zip(RESULTS, (110.0, 70.0, 50.0, loop, 30.0), strict=True)
    }
    return ActionScore(action, 4, 300, numbers, {"sync": Cost(60.0, 1.0)}, "key")


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
    benchmark = motion_tables.MotionBenchmark(
        "Title", "imocap benchmark x", "data", "fine_tuned", scores
    )
    text = motion_tables.markdown(benchmark)
    assert "| jump | 110.0 | 70.0 | 50.0 | 50.0 | 30.0 | 50 |" in text
    assert "| 4 videos | after loop | 66.53 | 45.0 ± 5.0 | 50.33 | 22.5 ± 2.5 |" in text
    assert "`imocap benchmark x`" in text
    assert "jump,after loop,mpjpe_scaled_mm,50.0" in motion_tables.csv_text(benchmark)
    numbers = json.loads(motion_tables.json_text(benchmark))
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


def made_page(root: Path, text: str) -> Path:
    page = root / docs.PAGES[0]
    page.parent.mkdir(parents=True)
    page.write_text(text)
    return page


def test_every_page_with_the_marks_gets_the_table(tmp_path: Path) -> None:
    page = made_page(tmp_path, PAGE)
    docs.check_marks(tmp_path, "trials")
    front = tmp_path / docs.PAGES[1]
    front.write_text("# No marks\n")
    assert docs.put_into_docs(tmp_path, "trials", "# T\n\n| a |\n") == [page]
    assert "-->\n\n| a |\n\n<!-- end -->" in page.read_text()
    front.write_text(PAGE)
    assert docs.put_into_docs(tmp_path, "trials", "# T\n\n| a |\n") == [page, front]


def test_a_page_without_the_place_is_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(WrongUse, match="<!-- table yoga -->"):
        docs.check_marks(tmp_path, "yoga")


def test_every_documented_table_has_its_place() -> None:
    for name in ("protocol-released-fine_tuned-4v", "trials-fine_tuned-4v", "rendered-4v",
                 "stability", "wrong_start", "degraded", "collect", "screening", "performers",
                 "moving_camera", "ablations-trials", "solver", "speed", "cost"):  # fmt: skip
        assert len(docs.pages_of(ROOT, name)) == 1, name


HEADLINES = {
    "protocol": ("protocol-released-fine_tuned-4v", "imocap benchmark protocol"),
    "trials": ("trials-fine_tuned-4v", "imocap benchmark trials"),
    "rendered": ("rendered-4v", "imocap benchmark rendered"),
}


def means(name: str) -> dict[str, str]:
    """The mean of every result and of the sync error in a measured table, as it stands there."""
    (page,) = docs.pages_of(ROOT, name)
    rows: dict[str, str] = {}
    block = page.read_text().split(f"<!-- table {name} -->")[1].split(docs.END)[0]
    for line in block.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[0] == "action":
            head = cells
        elif cells[0] == "**mean**":
            rows = dict(zip(head, cells, strict=True)) | rows  # the first table's columns win
    return {key: value.split(" ")[0] for key, value in rows.items()}


@pytest.mark.parametrize("name", HEADLINES)
def test_the_headline_numbers_are_the_measured_ones(name: str) -> None:
    label, command = HEADLINES[name]
    measured = means(label)
    results = [measured[key] for key in ("monocular", "single pass", "after loop", "oracle")]
    sync = measured.get("sync %, after loop") or measured["sync %"]
    guide, front = (ROOT / docs.PAGES[0]).read_text(), (ROOT / "README.md").read_text()
    (row,) = (line for line in guide.splitlines() if line.startswith(f"| `{name}` | "))
    assert [cell.strip(" *") for cell in row.split("|")[3:-1]] == [
        *results, f"{measured['gap closed %']} %", f"{sync} %"
    ]  # fmt: skip
    (row,) = (line for line in front.splitlines() if command in line and "**" in line)
    numbers = [cell.strip(" *") for cell in row.split("|")[-5:-1]]
    assert numbers[:3] == [results[0], results[2], results[3]]
    assert float(numbers[3].removesuffix(" %")) == pytest.approx(float(sync), abs=0.051)


def test_the_command_puts_its_table_into_the_page(tmp_path, monkeypatch, capsys):
    page = made_page(tmp_path, "<!-- table ablations-trials -->\n<!-- end -->\n")
    monkeypatch.setattr(ablations_report, "measure", lambda *_: (None, tmp_path))
    monkeypatch.setattr(ablations_report, "markdown", lambda _: "# Found\n\n| [a] |\n")
    monkeypatch.setattr("sys.argv", ["imocap"])
    assert (
        main(["--root", str(tmp_path), "benchmark", "ablations", "--on", "trials", "--docs"]) == 0
    )
    assert "-->\n\n| [a] |\n\n<!-- end -->" in page.read_text()
    assert "| [a] |" in capsys.readouterr().out


def test_every_name_has_its_measurement() -> None:
    assert set(MEASUREMENTS) == set(get_args(BenchmarkName))
    for name in MEASUREMENTS:
        assert callable(report_of(name))
    readme = (ROOT / "benchmarks" / "README.md").read_text()
    rows = {line.split("`")[1]: line for line in readme.splitlines() if line.startswith("| `")}
    assert all(f"`{folder}/`" in rows[name] for name, folder in MEASUREMENTS.items())


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_ends_and_a_fault_stops_no_other(jobs: int) -> None:
    tasks = [(f"t{n}", (n,)) for n in (2, 3, 4)]
    ended = {e.name: e for e in each(halve, tasks, jobs, Silent())}
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
        list(each(stop, [(f"t{n}", (n,)) for n in range(3)], 1, Silent()))


def outcome(how: str) -> Outcome:
    class Kept(Stored):
        key = "k"  # type: ignore[assignment]

    stored = Kept.__new__(Kept)
    return Outcome("sync", how, stored, 1.0)  # type: ignore[arg-type]


def test_a_meter_keeps_the_cost_of_what_was_made(tmp_path: Path) -> None:
    meter = Meter(Silent(), tmp_path / "costs")
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
