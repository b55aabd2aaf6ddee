"""Numbers of a run against the committed baseline: pure, so that worsened numbers can be planted.

A run's scores and the baseline's values have the same shape: action -> result -> metric -> value.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

BASELINE = Path(__file__).with_name("baseline.yaml")
FIELDS = ("better", "tolerance_pct", "tolerance_least", "why")
HEAD = """\
# What the pipeline scored when its numbers were last accepted; docs/regression.md says how to read
# it. `values` are written by `make baseline`; `metrics` (which way is better, how much worse is
# still the same, and why) are written by hand and kept.
"""

Results = Mapping[str, Mapping[str, float]]  # of one action
Scores = Mapping[str, Results]


@dataclass(frozen=True)
class Watch:
    """How one metric is compared; the unit of tolerance_least is the metric's."""

    better: Literal["lower", "higher"]
    tolerance_pct: float  # of the baseline's value
    tolerance_least: float  # where the value is so small that a percentage says nothing
    why: str

    def allowed(self, value: float) -> float:
        """The worst value that still counts as `value`."""
        tolerance = max(self.tolerance_pct / 100 * abs(value), self.tolerance_least)
        return value + tolerance if self.better == "lower" else value - tolerance

    def holds(self, value: float, got: float | None) -> bool:
        """Whether `got` is no regression from `value`; not scored (None, NaN) is one."""
        if got is None or not math.isfinite(got):
            return False
        limit = self.allowed(value)
        return got <= limit if self.better == "lower" else got >= limit


@dataclass(frozen=True)
class Baseline:
    """What is watched, and the accepted values."""

    metrics: Mapping[str, Watch]
    values: Scores


@dataclass(frozen=True)
class Verdict:
    """One number of a run beside its baseline."""

    action: str
    result: str
    metric: str
    better: str
    baseline: float
    allowed: float
    got: float | None
    holds: bool


def parse(text: str) -> Baseline:
    """The baseline of a YAML text. ValueError names every row that is not complete."""
    data = yaml.safe_load(text)
    metrics: dict[str, Any] = data["metrics"]
    values: dict[str, Any] = data["values"]
    faults = [fault for name, row in metrics.items() for fault in _faults(name, row)]
    faults += [
        f"values.{action}.{result}.{metric}: no entry below metrics says how to compare it"
        for action, results in values.items()
        for result, row in results.items()
        for metric in row
        if metric not in metrics
    ]
    if faults:
        raise ValueError("\n".join(faults))
    return Baseline({name: Watch(**row) for name, row in metrics.items()}, values)


def _faults(name: str, row: Mapping[str, Any]) -> list[str]:
    """What is wrong with one entry of `metrics`."""
    if set(row) != set(FIELDS):
        return [f"metrics.{name}: expected {', '.join(FIELDS)}, got {', '.join(row)}"]
    faults = []
    if row["better"] not in ("lower", "higher"):
        faults.append(f"metrics.{name}.better: expected lower or higher, got {row['better']}")
    if not (row["tolerance_pct"] > 0 and row["tolerance_least"] > 0):
        faults.append(f"metrics.{name}: both tolerances must be above 0")
    if not (row["why"] or "").strip():
        faults.append(f"metrics.{name}.why: expected a reason for the tolerance")
    return faults


def document(baseline: Baseline) -> str:
    """The YAML text of a baseline: one number a line, four decimals."""
    lines = [HEAD + "metrics:"]
    for name, watch in baseline.metrics.items():
        lines += [
            f"  {name}:",
            f"    better: {watch.better}",
            f"    tolerance_pct: {watch.tolerance_pct}",
            f"    tolerance_least: {watch.tolerance_least}",
            f"    why: {watch.why}",
        ]
    lines.append("values:")
    for action, results in baseline.values.items():
        lines.append(f"  {action}:")
        for result, row in results.items():
            lines.append(f"    {result}:")
            lines += [f"      {metric}: {value:.4f}" for metric, value in row.items()]
    return "\n".join(lines) + "\n"


def watched(scores: Scores, metrics: Mapping[str, Watch]) -> Scores:
    """The scores that a baseline keeps, in the order of its metrics."""
    return {
        action: {
            result: {metric: row[metric] for metric in metrics if metric in row}
            for result, row in results.items()
        }
        for action, results in scores.items()
    }


def compare(
    baseline: Baseline, action: str, got: Mapping[str, Mapping[str, float]]
) -> list[Verdict]:
    """Every row of the baseline for `action` beside what a run scored.

    Being better than the baseline is no fault: only a loss beyond the tolerance is.
    """
    verdicts = []
    for result, row in baseline.values[action].items():
        for metric, value in row.items():
            watch, found = baseline.metrics[metric], got.get(result, {}).get(metric)
            verdicts.append(
                Verdict(
                    action,
                    result,
                    metric,
                    watch.better,
                    value,
                    watch.allowed(value),
                    found,
                    watch.holds(value, found),
                )
            )
    return verdicts


def lost(verdicts: list[Verdict]) -> list[Verdict]:
    """The regressions."""
    return [v for v in verdicts if not v.holds]


def table(verdicts: list[Verdict]) -> str:
    """Which metric of which result, baseline, allowed, got: what a failing test prints."""
    head = ("action", "result", "metric", "better", "baseline", "allowed", "got")
    rows = [
        (v.action, v.result, v.metric, v.better, _number(v.baseline), _limit(v), _number(v.got))
        for v in verdicts
    ]
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [
        "  ".join(
            cell.rjust(width) if i > 3 else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in (head, *rows)
    ]
    return "\n".join(lines)


def _limit(verdict: Verdict) -> str:
    return f"{'<=' if verdict.better == 'lower' else '>='} {_number(verdict.allowed)}"


def _number(value: float | None) -> str:
    return "not scored" if value is None else f"{value:.3f}"
