"""The tables of a benchmark: Markdown for people, CSV and JSON for programs."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field

from benchmarks.scoring.costs import Cost
from benchmarks.scoring.score_file import RESULTS, ActionScore

SCALED, PA, PLAIN = "mpjpe_scaled_mm", "pa_mpjpe_mm", "mpjpe_mm"
SYNC, SYNC_MS, MATCHED = "sync_error_pct", "sync_error_ms", "matched_share"
CAMERA = "camera_rotation_error_deg"
ROOT = "root_path_aligned_error_mm"
ABSENT = "–"
SHORT = ((SCALED, 1), (PA, 1), (SYNC, 2), (CAMERA, 1))

# The paper's Tables 1 and 2 (Human3.6M, one motion resampled, four videos, fine-tuned 2D unless
# said otherwise): what it is called there, our result, MPJPE, P-MPJPE, sync error in %.
PaperRow = tuple[str, str, float | None, float | None, float | None]
PAPER: tuple[PaperRow, ...] = (
    ("HMMR", "estimator", 109.80, 78.26, None),
    ("one video", "monocular", 80.65, 62.58, None),
    ("no iteration", "single pass", 71.49, 54.12, 0.91),
    ("4 videos", "after loop", 66.53, 50.33, 0.77),
    ("(known cameras and frames)", "oracle", None, None, None),
)
PAPER_GENERIC: PaperRow = ("4 videos, generic 2D", "after loop", 76.48, 53.34, None)
PAPER_FEWER: dict[int, PaperRow] = {
    1: ("1 video", "after loop", 80.65, 62.58, None),
    2: ("2 videos", "after loop", 78.45, 59.42, None),
    3: ("3 videos", "after loop", 71.48, 53.77, None),
}


@dataclass(frozen=True)
class Benchmark:
    """What was run: its title, the command that makes it, the data, the scores, and the actions of
    the data that have none (not run yet, or by other code)."""

    title: str
    command: str
    data: str
    detector: str  # "fine_tuned", "generic" or ""
    scores: list[ActionScore]
    missing: list[str] = field(default_factory=list)


def mean_and_error(values: Sequence[float]) -> tuple[float, float]:
    """Mean and its standard error (NaN for less than two values)."""
    count = len(values)
    if count == 0:
        return math.nan, math.nan
    mean = sum(values) / count
    if count < 2:
        return mean, math.nan
    spread = math.sqrt(sum((value - mean) ** 2 for value in values) / (count - 1))
    return mean, spread / math.sqrt(count)


def gap_closed(monocular: float | None, reached: float | None, oracle: float | None) -> float:
    """Share of the way from the monocular fit to the oracle, in %; NaN when there is no way."""
    if monocular is None or reached is None or oracle is None or monocular <= oracle:
        return math.nan
    return 100.0 * (monocular - reached) / (monocular - oracle)


def markdown(benchmark: Benchmark) -> str:
    """The whole report."""
    scores = benchmark.scores
    parts = [
        f"# {benchmark.title}",
        f"Made by `{benchmark.command}`. Data: {benchmark.data}. Means over videos, then actions, "
        f"± standard error over actions. {cost_sentence([s.costs for s in scores])} "
        "docs/metrics.md defines every number." + missing_sentence(benchmark.missing),
        "## Against the paper",
        "MPJPE is `mpjpe_scaled_mm`, the one that the released evaluation computes. The paper's "
        "data are others (Human3.6M), so only differences between rows compare.",
        _against_paper(benchmark),
    ]
    for title, metric in (("MPJPE, scaled (mm)", SCALED), ("P-MPJPE (mm)", PA)):
        parts += [f"## {title}", _by_result(scores, metric)]
    parts += ["## Correspondences and cameras", _sync_table(scores)]
    return "\n\n".join(parts) + "\n"


def summary(benchmark: Benchmark) -> str:
    """A table of a few lines, for the front page."""
    scores = benchmark.scores
    rows = [
        [result, *(_mean(scores, result, metric, digits) for metric, digits in SHORT)]
        for result in RESULTS
    ]
    head = ["", "MPJPE, scaled (mm)", "P-MPJPE (mm)", "sync error (%)", "cameras (°)"]
    told = f"`{benchmark.command}`: mean over {len(scores)} actions ± standard error. "
    return f"{told}Data: {benchmark.data}.{missing_sentence(benchmark.missing)}\n\n" + table_of(
        head, rows
    )


def cost_sentence(costs: Sequence[Mapping[str, Cost]]) -> str:
    """Total time and most memory of what was made (each stage counted where it was measured)."""
    every = [cost for action in costs for cost in action.values()]
    if not every:
        return "Time and memory were not measured."
    seconds, peak = sum(c.seconds for c in every), max(c.peak_gb for c in every)
    return f"All of it took {seconds:.0f} s when it was made, at most {peak:.1f} GB of memory."


def missing_sentence(missing: Sequence[str]) -> str:
    """Which actions the table lacks."""
    return f" **Missing (not measured on this code): {', '.join(missing)}.**" if missing else ""


def csv_text(benchmark: Benchmark) -> str:
    """Long form: action, result, metric, value."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["action", "result", "metric", "value"])
    for score in benchmark.scores:
        for result, metrics in score.numbers.items():
            writer.writerows([score.action, result, name, v] for name, v in metrics.items())
    return out.getvalue()


def json_text(benchmark: Benchmark) -> str:
    """Everything, with the means."""
    means = {
        result: {
            metric: dict(zip(("mean", "standard_error"), mean_and_error(found), strict=True))
            for metric in sorted({m for s in benchmark.scores for m in s.numbers.get(result, {})})
            if (found := _values(benchmark.scores, result, metric))
        }
        for result in RESULTS
    }
    plain = json.dumps({**asdict(benchmark), "means": means}, indent=1)
    return plain.replace("NaN", "null") + "\n"


def _against_paper(benchmark: Benchmark) -> str:
    ours = PAPER_GENERIC if benchmark.detector == "generic" else None
    ours = PAPER_FEWER.get(max(score.videos for score in benchmark.scores), ours)
    rows = []
    for row in PAPER:
        name, result, mpjpe, pa, sync = ours if ours and row[1] == "after loop" else row
        own = [_mean(benchmark.scores, result, metric, 1) for metric in (SCALED, PA)]
        own.append(_mean(benchmark.scores, result, SYNC, 2))
        paper = [ABSENT if value is None else f"{value:.2f}" for value in (mpjpe, pa, sync)]
        mixed = [cell for pair in zip(paper, own, strict=True) for cell in pair]
        rows.append([name, result, *mixed])
    head = ["paper", "here", "MPJPE, paper", "here", "P-MPJPE, paper", "here"]
    return table_of([*head, "sync %, paper", "here"], rows)


def _by_result(scores: Sequence[ActionScore], metric: str) -> str:
    rows = []
    for score in scores:
        values = [score.of(result, metric) for result in RESULTS]
        gap = gap_closed(*(score.of(r, metric) for r in ("monocular", "after loop", "oracle")))
        rows.append([score.action, *(cell(v, 1) for v in values), cell(gap, 0)])
    means = [mean_and_error(_values(scores, result, metric))[0] for result in RESULTS]
    gap = gap_closed(means[1], means[3], means[4])
    rows.append(["**mean**", *(_mean(scores, r, metric, 1) for r in RESULTS), cell(gap, 0)])
    return table_of(["action", *RESULTS, "gap closed %"], rows)


def _sync_table(scores: Sequence[ActionScore]) -> str:
    columns: list[tuple[str, str, str, int]] = [
        ("sync %, single pass", "single pass", SYNC, 2),
        ("sync %, after loop", "after loop", SYNC, 2),
        ("sync ms, after loop", "after loop", SYNC_MS, 0),
        ("matched share", "after loop", MATCHED, 2),
        ("camera °, single pass", "single pass", CAMERA, 1),
        ("camera °, after loop", "after loop", CAMERA, 1),
        ("root path mm, after loop", "after loop", ROOT, 0),
    ]
    rows = [
        [s.action, str(s.videos), str(s.frames), *(cell(s.of(r, m), d) for _, r, m, d in columns)]
        for s in scores
    ]
    rows.append(["**mean**", "", "", *(_mean(scores, r, m, d) for _, r, m, d in columns)])
    return table_of(["action", "videos", "frames", *(name for name, *_ in columns)], rows)


def _values(scores: Sequence[ActionScore], result: str, metric: str) -> list[float]:
    return [value for s in scores if (value := s.of(result, metric)) is not None]


def _mean(scores: Sequence[ActionScore], result: str, metric: str, digits: int) -> str:
    return mean_cell(_values(scores, result, metric), digits)


def mean_cell(values: Sequence[float], digits: int) -> str:
    """Mean ± standard error, or the sign for none."""
    mean, error = mean_and_error(values)
    if not math.isfinite(mean):
        return ABSENT
    return f"{mean:.{digits}f}" + (f" ± {error:.{digits}f}" if math.isfinite(error) else "")


def cell(value: float | None, digits: int) -> str:
    """A number of a table, or the sign for none."""
    return ABSENT if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def table_of(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    line: Callable[[Sequence[str]], str] = lambda cells: "| " + " | ".join(cells) + " |"  # noqa: E731
    return "\n".join([line(head), line(["---"] * len(head)), *(line(row) for row in rows)])
