"""`imocap benchmark ablations`: what each part of the method is worth."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from rich.table import Table

from benchmarks import scoring
from benchmarks.ablation_variants import VARIANTS, Variant, VariantRun, chosen_variants, score_rival
from benchmarks.actions.captured_videos import DATA, RESAMPLED, TITLES, Choice
from benchmarks.actions.prepare import action_names, chosen_names, existing_job, ready_job
from benchmarks.motion import score_path
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay, each, was_interrupted
from benchmarks.tables import (
    ABSENT,
    CAMERA,
    DETAILS,
    PA,
    SCALED,
    SYNC,
    cell,
    gap_closed,
    markdown_table,
    mean_and_error,
    mean_cell,
    write_texts,
)
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

# The paper's claims, tested by paired differences over the same actions.

DECIDED = 2.0  # standard errors that a mean difference must exceed
UNITS = {SCALED: ("scaled MPJPE", "mm", 1), PA: ("P-MPJPE", "mm", 1), SYNC: ("sync error", "%", 2)}
POSE, ALL = (SCALED, PA), (SCALED, PA, SYNC)

VariantScores = Mapping[str, Mapping[str, scoring.ActionScore]]  # variant -> action -> score


@dataclass(frozen=True)
class Claim:
    """That one variant has lower errors than another.

    common: the number of first videos that are compared, where one of the two has fewer videos; 0
    for all.
    """

    title: str
    better: str
    worse: str
    metrics: tuple[str, ...]
    common: int = 0


PAPER_CLAIMS = (
    Claim("Two videos are better than one", "videos_2", "videos_1", POSE, common=1),
    Claim("Three videos are better than two", "videos_3", "videos_2", POSE, common=2),
    Claim("Four videos are better than three", "default", "videos_3", POSE, common=3),
    Claim("Several videos are better than a monocular fit", "default", "monocular", POSE),
    Claim("Iteration is better than a single pass", "default", "no_iteration", ALL),
    Claim("Cycle consistency is better than none", "default", "no_cycle", (SYNC,)),
    Claim("Cycle consistency is better than none, paper's pipeline, softmap",
          "paper_softmap", "paper_none", (SYNC,)),
    Claim("Cycle consistency is better than none, paper's pipeline, ALS",
          "paper_als", "paper_none", (SYNC,)),
    Claim("Cycle consistency is better than none, paper's pipeline, SVT",
          "paper_svt", "paper_none", (SYNC,)),
    Claim("Low rank (s = 1) is better than one model", "rank_1", "one_model", POSE),
    Claim("A shared motion with deviations is better than one model", "default", "one_model", POSE),
    Claim("A fine-tuned detector is better than a generic one", "default", "generic", ALL),
    Claim("Pose-based synchronisation is better than TCC", "default", "tcc", (SYNC,)),
)  # fmt: skip
OUR_CLAIMS = (
    Claim("The default is better than the paper's pipeline", "default", "paper_softmap", ALL),
    Claim("Rank 1 is better than rank 2", "rank_1", "rank_2", POSE),
    Claim("Rank 2 is better than rank 3", "rank_2", "rank_3", POSE),
    Claim("No outlier video is better than one", "default", "outlier", ALL),
    Claim("Pose-based synchronisation is better than an equal stretch",
          "default", "stretch", (SYNC,)),
)  # fmt: skip


def differences(claim: Claim, metric: str, scores: VariantScores) -> list[float]:
    """Error of the worse minus error of the better, for each action that both were scored on."""
    result = {v.name: v.result for v in VARIANTS}
    better, worse = scores.get(claim.better, {}), scores.get(claim.worse, {})
    compared = scoring.first_videos(claim.common) if claim.common else result[claim.better]
    pairs = [
        (worse[a].of(result[claim.worse], metric), better[a].of(compared, metric))
        for a in better
        if a in worse
    ]
    return [w - b for w, b in pairs if w is not None and b is not None]


def verdict(values: Sequence[float]) -> str:
    """confirmed, refuted, or undecided: whether the mean is 2 standard errors from zero."""
    mean, error = mean_and_error(values)
    if not math.isfinite(error) or abs(mean) <= DECIDED * error:
        return "undecided"
    return "confirmed" if mean > 0 else "refuted"


def sentences(claims: Sequence[Claim], scores: VariantScores) -> list[str]:
    """One sentence for each claim that was measured."""
    lines = []
    for claim in claims:
        parts = [
            _part(metric, values)
            for metric in claim.metrics
            if (values := differences(claim, metric, scores))
        ]
        if parts:
            lines.append(f"{claim.title}: {'; '.join(parts)}.")
    return lines


def _part(metric: str, values: Sequence[float]) -> str:
    name, unit, digits = UNITS[metric]
    mean, error = mean_and_error(values)
    by = f"{mean:+.{digits}f}" + (f" ± {error:.{digits}f}" if math.isfinite(error) else "")
    wins = sum(value > 0 for value in values)
    return f"**{verdict(values)}** in {name} ({by} {unit}, {wins} of {len(values)} actions)"


# The tables of the ablations, and the sentences on the paper's claims.

COLUMNS = ((SCALED, "mpjpe_mm", 1), (PA, "pa_mpjpe_mm", 1), (SYNC, "sync_pct", 2))


@dataclass(frozen=True)
class Ablations:
    """scores[variant][action] of an action set; `actions` are all of its data, scored or not."""

    title: str
    command: str
    data: str
    actions: list[str]
    scores: Mapping[str, Mapping[str, scoring.ActionScore]]

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
        f"standard error over actions. {scoring.cost_sentence(_all_costs(table))}{_missing(table)}",
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


def _all_costs(table: Ablations) -> list[Mapping[str, scoring.Cost]]:
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


# Scores of every ablation on a set of actions, brought up to date, and their table.

Scores = dict[str, scoring.ActionScore]  # by variant


def measure(
    workspace: Workspace, base: Choice, names: Sequence[str], display: Display, jobs: int = 1
) -> tuple[Ablations, Path]:
    """Run the variants `names` (all when empty) of an action set, write the tables after each
    action; them and their folder.

    Runs that share detector, sampling and videos share their artifacts, and runs of the plain
    benchmark are not repeated. WorkFailed at the end when something failed.
    """
    folder = base.folder(workspace.root).parent / f"ablations-{base.set_label}"
    every, chosen = action_names(workspace.root, base), chosen_names(workspace.root, base)
    variants = chosen_variants(base.name, names)
    by_action: dict[str, Scores] = {}
    for action in every:
        left_out = action not in chosen
        others = [v for v in VARIANTS if left_out or v not in variants]
        by_action[action] = _cached(workspace, base, action, others)
    tasks = [(name, (workspace.root, base, name, variants)) for name in chosen]
    faults = []
    for ended in each(one_action, tasks, jobs, display):
        if ended.result is None:
            faults.append(f"{ended.name}: {ended.fault}")
            continue
        scores, missed = ended.result
        by_action[ended.name] |= scores
        faults += [f"{ended.name}, {fault}" for fault in missed]
        write(_table(base, every, by_action), folder)
    if faults:
        raise WorkFailed("\n".join(faults))
    return _table(base, every, by_action), folder


def one_action(
    display: Display, root: Path, base: Choice, name: str, variants: Sequence[Variant]
) -> tuple[Scores, list[str]]:
    """The scores of one action by variant, and a sentence for each variant that failed."""
    scores: Scores = {}
    faults = []
    for variant in variants:
        try:
            variant_display = ActionDisplay(display, f"{name}, {variant.name}")
            scores[variant.name] = _score(variant_display, Workspace(root), base, name, variant)
        except WorkFailed as error:
            if was_interrupted(error):
                raise
            faults.append(f"{variant.name}: {error}")
    return scores, faults


def write(table: Ablations, folder: Path) -> None:
    """The three tables."""
    texts = {
        "table.md": markdown(table),
        "numbers.csv": csv_text(table),
        "numbers.json": json_text(table),
    }
    write_texts(folder, texts)


def choice_of(base: Choice, run: VariantRun) -> Choice:
    """The inputs of a run on the data of `base`."""
    return replace(base, detector=run.detector, videos=run.videos, outlier=run.outlier, only=())


def _score(
    display: Display, workspace: Workspace, base: Choice, name: str, variant: Variant
) -> scoring.ActionScore:
    choice = choice_of(base, variant.run)
    folder = choice.folder(workspace.root)
    job = ready_job(workspace, choice, name, variant.run.sets, display)
    file = score_path(folder, name, _scores_of(variant))
    if variant.is_rival:
        return score_rival(variant.result, job, display, file, folder / "costs")
    plain = not variant.run.sets and not variant.run.outlier
    return scoring.score_action(job, display, file, folder / "costs", with_oracle=plain)


def _cached(workspace: Workspace, base: Choice, name: str, variants: Sequence[Variant]) -> Scores:
    """The stored numbers that are still valid."""
    valid: Scores = {}
    by_file: dict[Path, scoring.ActionScore | None] = {}
    for variant in variants:
        choice = choice_of(base, variant.run)
        file = score_path(choice.folder(workspace.root), name, _scores_of(variant))
        if not file.is_file():
            continue
        if file not in by_file:
            job = existing_job(workspace, choice, name, variant.run.sets)
            code = [Path(__file__).with_name("ablation_variants.py")] if variant.is_rival else []
            by_file[file] = scoring.cached_score(job, file, *code)
        score = by_file[file]
        if score is not None:
            valid[variant.name] = score
    return valid


def _scores_of(variant: Variant) -> str:
    return variant.result if variant.is_rival else variant.run.label


def _table(base: Choice, every: Sequence[str], by_action: dict[str, Scores]) -> Ablations:
    command = f"imocap benchmark ablations --on {base.name}"
    if base.name in RESAMPLED:
        command += f" --sampling {base.sampling}"
    command += " --data FOLDER" if base.data is not None else ""
    by_variant = {
        variant.name: {a: by_action[a][variant.name] for a in every if variant.name in by_action[a]}
        for variant in chosen_variants(base.name, ())
    }
    return Ablations(
        f"Ablations. {TITLES[base.name]}", command, DATA[base.name], list(every), by_variant
    )


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    if (options.detector, options.videos) != ("fine_tuned", 4):
        raise WrongUse("ablations set --detector and --videos themselves; leave both out")
    base = Choice(options.on, sampling=options.sampling, only=options.only, data=options.data)
    table, folder = measure(workspace, base, options.variants, display, options.jobs)
    text = markdown(table)
    return [text, f"Written to {folder}"]
