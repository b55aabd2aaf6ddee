"""`make measure`: records of commands, what is run again, and the tables that they leave."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import docs, measure
from benchmarks.measure import PLAN, PYTHON, Measurement

ROOT = Path(__file__).resolve().parents[2]
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
