"""`imocap benchmark protocol`, `trials`, `yoga`, `h36m`: how good the motion is."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from rich.table import Table

from benchmarks.actions.captured_videos import AS_GIVEN, DATA, TITLES, Choice
from benchmarks.actions.prepare import action_names, chosen_names, existing_job, ready_job
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay, each
from benchmarks.scoring import RESULTS, ActionScore, cached_score, cost_sentence, score_action
from benchmarks.tables import (
    ABSENT,
    ALL_JOINTS,
    CAMERA,
    DETAILS,
    MATCHED,
    PA,
    ROOT,
    SCALED,
    SYNC,
    SYNC_MS,
    cell,
    gap_closed,
    markdown_table,
    mean_and_error,
    mean_cell,
    missing_sentence,
    write_texts,
)
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

# The tables of `imocap benchmark protocol`, `trials`, `yoga` and `h36m`.

BODY = (  # metric, digits, heading
    ("pelvis_rotation_error_deg", 1, "pelvis °"),
    ("chest_rotation_error_deg", 1, "chest °"),
    ("head_rotation_error_deg", 1, "head °"),
    ("neck_direction_error_deg", 1, "neck °"),
    ("collars_direction_error_deg", 1, "collars °"),
    ("stretched_edges_pct", 1, "stretched edges %"),
    ("acceleration_error_m_s2", 1, "acceleration m/s²"),
    ("smoothed_truth_acceleration_error_m_s2", 1, "of the smoothed truth"),
    ("jitter_10m_s3", 1, "jitter 10 m/s³"),
    ("planted_foot_speed_mm_s", 0, "planted feet mm/s"),
    ("true_planted_foot_speed_mm_s", 0, "of the truth"),
)

# The paper's Tables 1 and 2 (Human3.6M, one motion resampled, four videos, fine-tuned 2D unless
# the row says otherwise): its name there, our result, MPJPE, P-MPJPE, sync error in %.
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
class MotionBenchmark:
    """Scores of a set of actions.

    command: the command that measures them. missing: the actions of the data without scores (not
    run yet, or by other code).
    """

    title: str
    command: str
    data: str
    detector: str  # "fine_tuned", "generic" or ""
    scores: list[ActionScore]
    missing: list[str] = field(default_factory=list)


def markdown(benchmark: MotionBenchmark) -> str:
    """The whole report."""
    scores = benchmark.scores
    parts = [
        f"# {benchmark.title}",
        f"Made by `{benchmark.command}`. Data: {benchmark.data}. Means over videos, then actions, "
        f"± standard error over actions. {cost_sentence([s.costs for s in scores])} "
        "MPJPE, scaled, mm on 12 joints, unless the column says otherwise."
        + missing_sentence(benchmark.missing),
        _overview(scores),
        DETAILS,
        "docs/metrics.md defines every number.",
        "## Against the paper",
        "MPJPE is `mpjpe_scaled_mm`, the one that the released evaluation computes. The paper's "
        "data are others (Human3.6M), so only differences between rows compare.",
        _against_paper(benchmark),
    ]
    tables = [("MPJPE, scaled (mm)", SCALED), ("P-MPJPE (mm)", PA)]
    if _has_all_joints(scores):
        tables.append(("MPJPE on 24 joints, not scaled (mm)", ALL_JOINTS))
    for title, metric in tables:
        parts += [f"## {title}", _by_result(scores, metric)]
    parts += ["## Correspondences and cameras", _sync_table(scores)]
    parts += ["## Trunk and motion, after the loop", _body_table(scores)]
    return "\n\n".join(parts) + "\n"


def csv_text(benchmark: MotionBenchmark) -> str:
    """Long form: action, result, metric, value."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["action", "result", "metric", "value"])
    for score in benchmark.scores:
        for result, metrics in score.numbers.items():
            writer.writerows([score.action, result, name, v] for name, v in metrics.items())
    return out.getvalue()


def json_text(benchmark: MotionBenchmark) -> str:
    """Everything, with the means."""
    means = {
        result: {
            metric: dict(zip(("mean", "standard_error"), mean_and_error(values), strict=True))
            for metric in sorted({m for s in benchmark.scores for m in s.numbers.get(result, {})})
            if (values := _values(benchmark.scores, result, metric))
        }
        for result in RESULTS
    }
    plain = json.dumps({**asdict(benchmark), "means": means}, indent=1)
    return plain.replace("NaN", "null") + "\n"


def _overview(scores: Sequence[ActionScore]) -> str:
    """A row an action: all results, and of the last one what else a reader asks first."""
    columns = [(result, result, SCALED, 1) for result in RESULTS if result != "estimator"]
    after = [("P-MPJPE, after loop", PA, 1), ("sync %, after loop", SYNC, 2)]
    columns += [(name, "after loop", m, d) for name, m, d in (*after, ("cameras °", CAMERA, 1))]
    rows = [[s.action, *(cell(s.of(r, m), d) for _, r, m, d in columns)] for s in scores]
    rows.append(["**mean**", *(_mean(scores, r, m, d) for _, r, m, d in columns)])
    for row, gap in zip(rows, _gaps(scores), strict=True):
        row.insert(5, cell(gap, 0))
    head = ["action", *(name for name, *_ in columns)]
    return markdown_table([*head[:5], "gap closed %", *head[5:]], rows)


def _gaps(scores: Sequence[ActionScore]) -> list[float]:
    """Gap closed by each action's result, and by the means over actions."""
    bounds = ("monocular", "after loop", "oracle")
    gaps = [gap_closed(*(score.of(result, SCALED) for result in bounds)) for score in scores]
    means = [mean_and_error(_values(scores, result, SCALED))[0] for result in bounds]
    return [*gaps, gap_closed(*means)]


def _against_paper(benchmark: MotionBenchmark) -> str:
    replaced = PAPER_GENERIC if benchmark.detector == "generic" else None
    replaced = PAPER_FEWER.get(max(score.videos for score in benchmark.scores), replaced)
    rows = []
    for row in PAPER:
        paper_row = replaced if replaced and row[1] == "after loop" else row
        name, result, mpjpe, pa, sync = paper_row
        measured = [_mean(benchmark.scores, result, metric, 1) for metric in (SCALED, PA)]
        measured.append(_mean(benchmark.scores, result, SYNC, 2))
        paper = [ABSENT if value is None else f"{value:.2f}" for value in (mpjpe, pa, sync)]
        mixed = [text for pair in zip(paper, measured, strict=True) for text in pair]
        rows.append([name, result, *mixed])
    head = ["paper", "here", "MPJPE, paper", "here", "P-MPJPE, paper", "here"]
    return markdown_table([*head, "sync %, paper", "here"], rows)


def _by_result(scores: Sequence[ActionScore], metric: str) -> str:
    rows = []
    for score in scores:
        values = [score.of(result, metric) for result in RESULTS]
        gap = gap_closed(*(score.of(r, metric) for r in ("monocular", "after loop", "oracle")))
        rows.append([score.action, *(cell(v, 1) for v in values), cell(gap, 0)])
    means = [mean_and_error(_values(scores, result, metric))[0] for result in RESULTS]
    gap = gap_closed(means[1], means[3], means[4])
    rows.append(["**mean**", *(_mean(scores, r, metric, 1) for r in RESULTS), cell(gap, 0)])
    return markdown_table(["action", *RESULTS, "gap closed %"], rows)


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
    return markdown_table(["action", "videos", "frames", *(name for name, *_ in columns)], rows)


def _body_table(scores: Sequence[ActionScore]) -> str:
    """What the twelve joints do not tell: the trunk's rotations, the surface, how it moves."""
    rows = [
        [score.action, *(cell(score.of("after loop", m), d) for m, d, _ in BODY)]
        for score in scores
    ]
    rows.append(["**mean**", *(_mean(scores, "after loop", m, d) for m, d, _ in BODY)])
    return markdown_table(["action", *(heading for *_, heading in BODY)], rows)


def _has_all_joints(scores: Sequence[ActionScore]) -> bool:
    """Whether the truth of any action has all 24 joints."""
    return any(_values(scores, result, ALL_JOINTS) for result in RESULTS)


def _values(scores: Sequence[ActionScore], result: str, metric: str) -> list[float]:
    return [value for s in scores if (value := s.of(result, metric)) is not None]


def _mean(scores: Sequence[ActionScore], result: str, metric: str, digits: int) -> str:
    return mean_cell(_values(scores, result, metric), digits)


# Scores of a set of actions, brought up to date, and their tables.


def measure(
    workspace: Workspace, choice: Choice, display: Display, jobs: int = 1
) -> tuple[MotionBenchmark, Path]:
    """Run what is not finished, write the tables after every action; them and their folder.

    The tables show every action whose stored numbers are still valid, also those not chosen now.
    WorkFailed, after all others have run, when an action failed.
    """
    folder = choice.folder(workspace.root)
    names, chosen = action_names(workspace.root, choice), chosen_names(workspace.root, choice)
    scores = _cached(workspace, choice, [name for name in names if name not in chosen])
    tasks = [(name, (workspace.root, choice, name)) for name in chosen]
    faults = []
    for ended in each(one_action, tasks, jobs, display):
        if ended.result is None:
            faults.append(f"{ended.name}: {ended.fault}")
            continue
        scores[ended.name] = ended.result
        write(_benchmark(choice, names, scores), folder)
    if faults:
        raise WorkFailed("\n".join(faults))
    return _benchmark(choice, names, scores), folder


def one_action(display: Display, root: Path, choice: Choice, name: str) -> ActionScore:
    """Bring one action up to date and score it."""
    action_display = ActionDisplay(display, name)
    job = ready_job(Workspace(root), choice, name, (), action_display)
    folder = choice.folder(root)
    return score_action(job, action_display, score_path(folder, name), folder / "costs")


def score_path(folder: Path, name: str, variant: str = "") -> Path:
    """The file of an action's numbers."""
    return folder / "scores" / variant / f"{name}.json"


def write(benchmark: MotionBenchmark, folder: Path) -> None:
    """The three tables."""
    write_texts(
        folder,
        {
            "table.md": markdown(benchmark),
            "numbers.csv": csv_text(benchmark),
            "numbers.json": json_text(benchmark),
        },
    )


def _cached(workspace: Workspace, choice: Choice, names: list[str]) -> dict[str, ActionScore]:
    folder = choice.folder(workspace.root)
    scores = {}
    for name in names:
        file = score_path(folder, name)
        if file.is_file():
            score = cached_score(existing_job(workspace, choice, name, ()), file)
            if score is not None:
                scores[name] = score
    return scores


def _benchmark(choice: Choice, names: list[str], scores: dict[str, ActionScore]) -> MotionBenchmark:
    return MotionBenchmark(
        TITLES[choice.name],
        choice.command,
        DATA[choice.name],
        "" if choice.name in AS_GIVEN else choice.detector,
        [scores[name] for name in names if name in scores],
        [name for name in names if name not in scores],
    )


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    if options.variants:
        raise WrongUse("--variants: only for `imocap benchmark ablations` and `sync`")
    choice = Choice(
        options.name,
        options.detector,
        options.sampling,
        options.videos,
        options.only,
        data=options.data,
    )
    benchmark, folder = measure(workspace, choice, display, options.jobs)
    text = markdown(benchmark)
    return [text, f"Written to {folder}"]
