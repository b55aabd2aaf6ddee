"""The tables of the ablations, and the sentences on the paper's claims."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from benchmarks.ablations.claims import OUR_CLAIMS, PAPER_CLAIMS, sentences
from benchmarks.ablations.variants import VARIANTS, Variant
from benchmarks.scoring.costs import Cost
from benchmarks.scoring.score_file import ActionScore
from benchmarks.tables import (
    ABSENT,
    CAMERA,
    DETAILS,
    PA,
    SCALED,
    SYNC,
    cell,
    cost_sentence,
    gap_closed,
    markdown_table,
    mean_and_error,
    mean_cell,
)

COLUMNS = ((SCALED, "mpjpe_mm", 1), (PA, "pa_mpjpe_mm", 1), (SYNC, "sync_pct", 2))


@dataclass(frozen=True)
class Ablations:
    """scores[variant][action] of an action set; `actions` are all of its data, scored or not."""

    title: str
    command: str
    data: str
    actions: list[str]
    scores: Mapping[str, Mapping[str, ActionScore]]

    def values(self, variant: Variant, metric: str) -> list[float]:
        """One number for each action that has it."""
        scores = self.scores.get(variant.name, {}).values()
        return [value for s in scores if (value := s.of(variant.result, metric)) is not None]

    @property
    def rows(self) -> list[Variant]:
        """The variants that have any score."""
        return [v for v in VARIANTS if self.scores.get(v.name)]


def markdown(table: Ablations) -> str:
    """The whole report."""
    parts = [
        f"# {table.title}",
        f"Made by `{table.command}`. Data: {table.data}. Means over videos, then actions, ± "
        f"standard error over actions. {cost_sentence(_all_costs(table))}{_missing(table)}",
        _overview(table),
        DETAILS,
        "docs/metrics.md defines every number.",
        "## Every variant",
        "MPJPE is `mpjpe_scaled_mm`; the paper's numbers are on Human3.6M, so only differences "
        "between rows compare. Seconds and memory are means over actions of a run from nothing to "
        "this result (TCC: one training).",
        _variants(table),
        "## What the paper claims",
        "Paired differences over actions, mean ± standard error; positive is as claimed. Where one "
        "side has fewer videos, both are scored on those. "
        "*Undecided*: the mean is within two standard errors of zero.",
        _list(sentences(PAPER_CLAIMS, table.scores)),
        "## What it does not claim",
        _list(sentences(OUR_CLAIMS, table.scores)),
    ]
    for title, metric, digits in (
        ("MPJPE, scaled (mm), by action", SCALED, 1),
        ("P-MPJPE (mm), by action", PA, 1),
        ("Sync error (%), by action", SYNC, 2),
    ):
        parts += [f"## {title}", _by_action(table, metric, digits)]
    return "\n\n".join(parts) + "\n"


def csv_text(table: Ablations) -> str:
    """Long form: variant, action, metric, value."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["variant", "action", "metric", "value"])
    for variant in table.rows:
        for action, score in table.scores[variant.name].items():
            numbers = score.numbers.get(variant.result, {})
            writer.writerows([variant.name, action, name, v] for name, v in numbers.items())
            cost = score.cost(variant.result)
            if cost is not None:
                writer.writerow([variant.name, action, "seconds", cost.seconds])
                writer.writerow([variant.name, action, "peak_gb", cost.peak_gb])
    return out.getvalue()


def json_text(table: Ablations) -> str:
    """Everything, with the means and the sentences."""
    means = {
        variant.name: {
            metric: dict(zip(("mean", "standard_error"), mean_and_error(values), strict=True))
            for metric, *_ in (*COLUMNS, (CAMERA,))
            if (values := table.values(variant, metric))
        }
        for variant in table.rows
    }
    parts = {
        **asdict(table),
        "means": means,
        "claims": sentences((*PAPER_CLAIMS, *OUR_CLAIMS), table.scores),
    }
    return json.dumps(parts, indent=1).replace("NaN", "null") + "\n"


def _overview(table: Ablations) -> str:
    """A row a variant: the means alone."""
    columns = (*((metric, digits) for metric, _, digits in COLUMNS), (CAMERA, 1))
    rows = [
        [v.title, *(cell(mean_and_error(table.values(v, m))[0], d) for m, d in columns)]
        for v in table.rows
    ]
    head = ["variant", "MPJPE, scaled (mm)", "P-MPJPE (mm)", "sync %", "cameras °"]
    return markdown_table(head, rows)


def _variants(table: Ablations) -> str:
    rows = []
    for variant in table.rows:
        cells = [variant.title, variant.switches, str(len(table.scores[variant.name]))]
        for metric, paper, digits in COLUMNS:
            paper_value: float | None = getattr(variant.paper, paper)
            cells += [cell(paper_value, 2), mean_cell(table.values(variant, metric), digits)]
        cells += [mean_cell(table.values(variant, CAMERA), 1), cell(_gap(table, variant), 0)]
        rows.append([*cells, *_cost(table, variant)])
    head = ["variant", "switches", "actions", "MPJPE, paper", "here", "P-MPJPE, paper", "here"]
    head += ["sync %, paper", "here", "camera °", "gap closed %", "s", "GB"]
    return markdown_table(head, rows)


def _gap(table: Ablations, variant: Variant) -> float:
    """Share of the way from the monocular fit to the oracle, over the actions that all have."""
    by_name = {v.name: v for v in VARIANTS}
    three = [by_name["monocular"], variant, by_name["oracle"]]
    scores = [table.scores.get(v.name, {}) for v in three]
    common = [a for a in scores[0] if all(a in s for s in scores)]
    means = []
    for v, score in zip(three, scores, strict=True):
        values = [score[a].of(v.result, SCALED) for a in common]
        means.append(mean_and_error([x for x in values if x is not None])[0])
    return float("nan") if variant.name in ("monocular", "estimator") else gap_closed(*means)


def _cost(table: Ablations, variant: Variant) -> list[str]:
    costs = [s.cost(variant.result) for s in table.scores[variant.name].values()]
    measured = [cost for cost in costs if cost is not None]
    if not measured:
        return [ABSENT, ABSENT]
    peak = max(c.peak_gb for c in measured)
    return [cell(sum(c.seconds for c in measured) / len(measured), 0), cell(peak, 1)]


def _by_action(table: Ablations, metric: str, digits: int) -> str:
    rows = []
    for variant in table.rows:
        scores = table.scores[variant.name]
        values = [scores[a].of(variant.result, metric) if a in scores else None for a in
                  table.actions]  # fmt: skip
        if any(value is not None for value in values):
            rows.append([variant.name, *(cell(value, digits) for value in values)])
    return markdown_table(["variant", *table.actions], rows)


def _all_costs(table: Ablations) -> list[Mapping[str, Cost]]:
    """Every artifact's cost once: variants share artifacts, and with them the measured cost."""
    every = [s.costs for scores in table.scores.values() for s in scores.values()]
    once = dict.fromkeys(item for costs in every for item in costs.items())
    return [{stage: cost} for stage, cost in once]


def _missing(table: Ablations) -> str:
    lacks = {v: [a for a in table.actions if a not in s] for v, s in table.scores.items()}
    whole = [v for v, a in lacks.items() if a and len(a) == len(table.actions)]
    partly = [f"{v} ({', '.join(a)})" for v, a in lacks.items() if a and v not in whole]
    missing = [*whole, *partly]
    return f" **Missing (not measured on this code): {'; '.join(missing)}.**" if missing else ""


def _list(lines: Sequence[str]) -> str:
    return "\n".join(f"* {line}" for line in lines) or "Nothing that can be compared was measured."
