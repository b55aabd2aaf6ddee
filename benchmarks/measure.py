"""All benchmarks on one state of the code, one after another: `make measure`.

    python -m benchmarks.measure                  # everything that is not measured yet
    python -m benchmarks.measure trials penn      # these only
    python -m benchmarks.measure --list           # what is measured, would run, cannot run
    python -m benchmarks.measure --write          # put the newest records into the documentation
    python -m benchmarks.measure --check          # 1 when the documentation says anything else

A record is two files in build/measure/CODE/ (CODE is made of the code that was measured): NAME.json
with commit, start, seconds and outcome, and NAME.md, the table. What was done on this code is not
run again, so that an interrupted run goes on where it ended; what failed is.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path

from benchmarks import docs
from benchmarks.actions.captured_videos import data_base
from benchmarks.docs import essentials
from benchmarks.rendered_action import check_detector
from benchmarks.tables import markdown_table
from imocap_core.errors import WorkFailed

# What `make measure` measures: each table of the documentation, its command, and what it needs.

PYTHON, IMOCAP = "python", "imocap"  # first word of a command: of the environment that runs it


@dataclass(frozen=True)
class Measurement:
    """One command, and the table that it leaves.

    table: its name between the marks of the documentation, and its folder below
    artifacts/benchmark unless `made` says otherwise. data: folders that it needs.
    detected: whether it needs the detector's environment. library: an optional one that it needs.
    in_parallel: whether it takes `--jobs`.
    """

    table: str
    command: tuple[str, ...]
    data: tuple[str, ...] = ()
    detected: bool = False
    library: str = ""
    in_parallel: bool = False
    made: str = ""
    read: Callable[[str], str] = essentials

    def file(self, root: Path) -> Path:
        """What the command writes last."""
        return root / (self.made or f"artifacts/benchmark/{self.table}/table.md")

    def lacks(self, root: Path) -> str:
        """Why it cannot be run here; empty when it can."""
        for name in self.data:
            if not (folder := data_base(root) / name).is_dir():
                return f"{folder} does not exist (IMOCAP_DATA names the folder of all data)"
        if self.library and find_spec(self.library) is None:
            return f"{self.library} is not installed"
        try:
            if self.detected:
                check_detector(root)
        except WorkFailed as error:
            return str(error)
        return ""


def fuzz_table(record: str) -> str:
    """Executions of damaged files, and how many were neither read nor refused in time."""
    became = json.loads(record)["became"]
    lost = [n for row in became.values() for how, n in row.items() if how not in OUTCOMES]
    tried = sum(n for row in became.values() for n in row.values())
    cells = [[f"damaged files of {len(became)} readers", f"{tried:,}", str(sum(lost))]]
    return markdown_table(ROBUSTNESS, cells)


def chaos_table(record: str) -> str:
    """Each disturbance: how often it was tried, and how often something was lost."""
    parts = json.loads(record)
    cells = [[name, f"{part['tried']:,}", str(part["lost"])] for name, part in parts.items()]
    return markdown_table(ROBUSTNESS, cells)


OUTCOMES = ("read", "refused")
ROBUSTNESS = ("tried", "times", "lost")


def _benchmark(
    words: str, table: str = "", *data: str, detected: bool = False, library: str = "",
    in_parallel: bool = False, made: str = "",
) -> Measurement:  # fmt: skip
    command = (IMOCAP, "benchmark", *words.split())
    return Measurement(table or words, command, data, detected, library, in_parallel, made)


PLAN = (  # the shorter ones first
    _benchmark("speed"),
    _benchmark("yoga"),
    _benchmark("solver"),
    _benchmark("performers", "", "trials", "performers"),
    _benchmark("real", "", "balance_beam", "crowd", detected=True),
    _benchmark("detector", "", "balance_beam", "crowd", detected=True),
    _benchmark("field", "", "field", in_parallel=True),
    _benchmark("protocol", "protocol-released-fine_tuned-4v", "protocol", in_parallel=True),
    _benchmark("trials", "trials-fine_tuned-4v", "trials", in_parallel=True),
    _benchmark("rendered", "rendered-4v", "trials", detected=True, in_parallel=True),
    _benchmark(
        "performances --videos 16", "performances", "performances",
        made="artifacts/benchmark/performances-fine_tuned/results.md",
    ),
    _benchmark("angles", "", "trials", made="artifacts/benchmark/angles-fine_tuned/results.md"),
    _benchmark("collect", "", "trials", "balance_beam", detected=True),
    _benchmark("moving_camera", library="pycolmap"),
    _benchmark("degraded", "", "balance_beam", "crowd", detected=True, in_parallel=True),
    _benchmark("penn --videos 2", "penn", "penn", in_parallel=True),
    _benchmark("screening", "", "train", in_parallel=True),
    _benchmark(
        "wrong_start", "", "trials", detected=True, in_parallel=True,
        made="artifacts/benchmark/trials-fine_tuned-4v/wrong_start/table.md",
    ),
    _benchmark("stability", "", "trials", "balance_beam", detected=True, in_parallel=True),
    _benchmark("cost"),
    _benchmark("ablations --on trials", "ablations-trials", "trials", in_parallel=True),
    Measurement(
        "fuzz", (PYTHON, "-m", "tools.fuzz.run", "--seconds", "1800"),
        made="build/fuzz/record.json", read=fuzz_table,
    ),
    Measurement(
        "chaos", (PYTHON, "-m", "tools.chaos.run", "--kills", "100"),
        made="build/chaos.json", read=chaos_table,
    ),
)  # fmt: skip


ROOT = Path(__file__).resolve().parents[1]
CODE = ("imocap_core", "stages", "benchmarks", "pipeline.yaml")  # what results depend on
COMMAND = "python -m benchmarks.measure"
FOLDER = Path("build/measure")
DONE, FAILED, SKIPPED = "done", "failed", "skipped"
STOPPED = (130, 143, -2, -15)  # exit codes of a command that was stopped alone
SUMMARY = "measured"  # the documentation's table of what was measured when


@dataclass(frozen=True)
class Record:
    """One measurement: when it began (UTC), on which commit, and how it ended."""

    table: str
    command: str
    commit: str
    began: str
    seconds: float
    outcome: str
    reason: str = ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code 0 when everything that was asked for is measured, or the pages are right."""
    options = _options(arguments)
    if options.check or options.write:
        folder = newest(ROOT / FOLDER)
        wrong = docs.stale(ROOT, tables_of(folder)) if options.check else []
        if options.write:
            docs.put(ROOT, tables_of(folder))
        _say(*(f"{page} differs from the records: {COMMAND} --write" for page in wrong))
        return 1 if wrong else 0
    chosen = [m for m in PLAN if not options.tables or m.table in options.tables]
    folder = ROOT / FOLDER / code_of(ROOT)
    if options.list:
        _say(*(f"{m.table:34} {state(folder, m, ROOT)}" for m in chosen))
        return 0
    if changed := _git("status", "--porcelain", "--", *CODE):
        _say(f"commit first: a measurement belongs to a commit, and these have changed:\n{changed}")
        return 2
    return measure(chosen, folder, options.jobs)


def measure(chosen: Sequence[Measurement], folder: Path, jobs: int) -> int:
    """Run what is not done, and put all tables into the documentation."""
    outcomes = []
    for number, measurement in enumerate(chosen, 1):
        record = record_of(folder, measurement.table)
        if record is None or record.outcome != DONE:
            place = f"[{number}/{len(chosen)}] {measurement.table}"
            _say(f"{place}: {' '.join(measurement.command)}{_usual(measurement.table)}")
            record = run(measurement, folder, jobs)
            _say(f"{place}: {record.outcome} in {record.seconds:.0f} s {record.reason}".rstrip())
        outcomes.append(record.outcome)
    docs.put(ROOT, tables_of(folder))
    counts = ", ".join(f"{outcomes.count(o)} {o}" for o in (DONE, FAILED, SKIPPED))
    _say(f"{counts}; records: {folder.relative_to(ROOT)}; in {', '.join(map(str, docs.PAGES))}")
    return 1 if FAILED in outcomes else 0


def run(measurement: Measurement, folder: Path, jobs: int = 1, root: Path = ROOT) -> Record:
    """Run one command, its output into NAME.log, and keep its record."""
    folder.mkdir(parents=True, exist_ok=True)
    commit, began = _git("rev-parse", "--short=12", "HEAD"), datetime.now(UTC)
    start, outcome, table = time.monotonic(), SKIPPED, ""
    if not (reason := measurement.lacks(root)):
        made = measurement.file(root)
        made.unlink(missing_ok=True)
        log = folder / f"{measurement.table}.log"
        code = _run(measurement, log, jobs, root)
        outcome = DONE if code == 0 and made.is_file() else FAILED
        if outcome == DONE:
            table = measurement.read(made.read_text(encoding="utf-8"))
        else:
            reason = f"exit code {code}; {log} has the output"
    record = Record(
        measurement.table, " ".join(measurement.command), commit,
        began.strftime("%Y-%m-%d %H:%M"), round(time.monotonic() - start, 1), outcome, reason,
    )  # fmt: skip
    (folder / f"{record.table}.md").write_text(table, encoding="utf-8")
    (folder / f"{record.table}.json").write_text(json.dumps(asdict(record), indent=1) + "\n")
    return record


def record_of(folder: Path, table: str) -> Record | None:
    """The record of a measurement on some code; None when it was not run."""
    file = folder / f"{table}.json"
    return Record(**json.loads(file.read_text(encoding="utf-8"))) if file.is_file() else None


def tables_of(folder: Path | None) -> dict[str, str]:
    """All measured tables of a folder of records by name, and that of the records themselves."""
    records = [r for m in PLAN if folder and (r := record_of(folder, m.table)) is not None]
    if not records or folder is None:
        return {}
    tables = {
        r.table: (folder / f"{r.table}.md").read_text(encoding="utf-8")
        for r in records
        if r.outcome == DONE
    }
    rows = [
        [f"`{r.command}`", r.commit, r.began, f"{r.seconds:,.0f}", r.reason or r.outcome]
        for r in records
    ]
    head = ("command", "commit", "began (UTC)", "seconds", "outcome")
    return tables | {SUMMARY: markdown_table(head, rows)}


def newest(folder: Path) -> Path | None:
    """The folder of the code that was measured last."""
    files = sorted(folder.glob("*/*.json"), key=lambda f: f.stat().st_mtime)
    return files[-1].parent if files else None


def code_of(root: Path) -> str:
    """A name of the committed code; what else is in a commit, pages for one, does not change it."""
    objects = _git("rev-parse", *(f"HEAD:{path}" for path in CODE), root=root)
    return hashlib.sha256(objects.encode()).hexdigest()[:12]


def state(folder: Path, measurement: Measurement, root: Path) -> str:
    """What is known about a measurement on this code."""
    record = record_of(folder, measurement.table)
    if record is not None and record.outcome != SKIPPED:
        return f"{record.outcome} in {record.seconds:.0f} s {record.reason}".rstrip()
    lacks = measurement.lacks(root)
    return f"{SKIPPED}: {lacks}" if lacks else f"to run{_usual(measurement.table)}"


def _usual(table: str) -> str:
    """How long it took on other code, in words; empty when it never ran."""
    files = (ROOT / FOLDER).glob(f"*/{table}.json")
    past = [r for f in files if (r := record_of(f.parent, table)) and r.outcome == DONE]
    last = max(past, key=lambda r: r.began, default=None)
    return "" if last is None else f" (took {last.seconds:.0f} s on {last.commit})"


def _run(measurement: Measurement, log: Path, jobs: int, root: Path) -> int:
    program, *words = measurement.command
    if program == IMOCAP:
        words = ["-c", "from imocap_core.cli import main; raise SystemExit(main())", *words]
    if measurement.in_parallel and jobs > 1:
        words += ["--jobs", str(jobs)]
    with log.open("wb") as out:
        child = [sys.executable, *words]
        code = subprocess.run(child, cwd=root, stdout=out, stderr=out, check=False).returncode
    if code in STOPPED:
        raise KeyboardInterrupt
    return code


def _git(*words: str, root: Path = ROOT) -> str:
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    names = [m.table for m in PLAN]
    parser.add_argument("tables", nargs="*", metavar="TABLE", help=f"of {', '.join(names)}")
    parser.add_argument("--jobs", type=int, default=1, help="actions at once")
    for option in ("list", "write", "check"):
        parser.add_argument(f"--{option}", action="store_true")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.tables if name not in names]:
        parser.error(f"{unknown[0]}: expected one of {', '.join(names)}")
    return options


def _say(*lines: str) -> None:
    for line in lines:
        sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        _say("stopped; the same command goes on where this one ended")
        sys.exit(130)
