"""`imocap benchmark degraded`: the whole pipeline on degraded real footage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from benchmarks import tables
from benchmarks.actions.action_folder import ActionVariant, is_made
from benchmarks.actions.captured_videos import data_folder
from benchmarks.degraded_footage import FOOTAGES, KINDS, Footage, footage_key, make_footage
from benchmarks.detector import PLAIN
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay, each
from benchmarks.rendered_action import check_detector
from benchmarks.scoring import ActionScore, cached_score, score_action
from benchmarks.stability import CAMERA_PAIRS, FRAME_PAIRS, VariantScore, variant_score
from imocap_core.artifacts.schemas import Redetect
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace

# The table of `imocap benchmark degraded`.

COLUMNS = (
    (tables.SCALED, 1, "MPJPE, scaled (mm)"),
    (tables.PA, 1, "P-MPJPE (mm)"),
    (tables.SYNC, 2, "sync %"),
    (FRAME_PAIRS, 2, "sync, frames"),
    (CAMERA_PAIRS, 2, "cameras °"),
)


@dataclass(frozen=True)
class DegradedScore:
    """The result of one footage of an action.

    contradicted: doubtful joints, detected where the other videos do not have them, which were
    looked at again. moved: joints that took another place.
    """

    action: str
    footage: Footage
    result: VariantScore
    contradicted: int = 0
    moved: int = 0


def markdown(
    scores: Sequence[DegradedScore], missing: Sequence[str] = (), absent: Sequence[str] = ()
) -> str:
    """The whole report. missing: names of what was not run; absent: why actions have no data."""
    head = ("action", "footage", "videos degraded", *(heading for *_, heading in COLUMNS))
    more = ("left out or mirrored", "joints looked at again", "joints moved")
    parts = [
        "# The pipeline on degraded footage",
        "Made by `imocap benchmark degraded`. Every action runs at the defaults, from pixels; "
        "numbers are those after the loop: MPJPE and sync % means over the videos, the "
        "other sync and cameras means over all pairs of videos." + tables.missing_sentence(missing),
        tables.markdown_table((*head, *more), [_row(score) for score in scores]),
    ]
    if absent:
        parts.append("**Not measured:**\n\n" + "\n".join(f"* {reason}" for reason in absent))
    return "\n\n".join(parts) + "\n"


def _row(score: DegradedScore) -> list[str]:
    result = score.result
    counts = (score.contradicted, score.moved)
    return [
        score.action,
        f"{result.title}: {result.fault}" if result.fault else result.title,
        score.footage.extent,
        *(tables.cell(result.of(metric), digits) for metric, digits, _ in COLUMNS),
        tables.ABSENT if result.fault else _screened(result),
        *(tables.ABSENT if result.fault else str(count) for count in counts),
    ]


def _screened(result: VariantScore) -> str:
    videos = [f"{video} left out" for video in result.excluded]
    videos += [f"{video} mirrored" for video in result.mirrored]
    return ", ".join(videos) or "none"


# Scores of every action of degraded footage, brought up to date.

NAME = "degraded"
ACTIONS = ("balance_beam", "crowd")


@dataclass(frozen=True)
class DegradedAction(ActionVariant):
    """One footage of one action, below the benchmark's folder."""

    footage: Footage

    @property
    def variant(self) -> str:
        """The name of the footage."""
        return self.footage.name


def check_choice(only: tuple[str, ...], variants: tuple[str, ...]) -> None:
    """WrongUse, naming what there is, for an unknown action or degradation."""
    names = (PLAIN.name, *KINDS)
    for option, given, there in (("--only", only, ACTIONS), ("--variants", variants, names)):
        unknown = [name for name in given if name not in there]
        if unknown:
            raise WrongUse(f"{option} {unknown[0]}: expected one of {', '.join(there)}")


def is_chosen(variant: DegradedAction, only: tuple[str, ...], variants: tuple[str, ...]) -> bool:
    """Whether an action's footage is to be run: as filmed always, to compare with."""
    kind = variant.footage.degradation.name
    return (not only or variant.action in only) and (
        not variants or kind in (PLAIN.name, *variants)
    )


def measure(
    workspace: Workspace,
    only: tuple[str, ...],
    variants: tuple[str, ...],
    display: Display,
    jobs: int = 1,
) -> tuple[str, Path]:
    """Run what is chosen and not finished, and write the table after every run; it and its folder.

    What is not chosen is shown where its stored numbers are valid. WorkFailed when no chosen action
    can be run; an action without data and a run that fails are named in the table.
    """
    check_choice(only, variants)
    check_detector(workspace.root)
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    sources, absent = _sources(workspace.root)
    if not any(action in sources for action in only or ACTIONS):
        raise WorkFailed("\n".join(absent[action] for action in only or ACTIONS))
    every = [DegradedAction(folder, action, f) for action in sources for f in FOOTAGES]
    chosen = {v.name: v for v in every if is_chosen(v, only, variants)}
    scores = {
        v.name: score
        for v in every
        if v.name not in chosen and (score := _stored(v, sources[v.action])) is not None
    }

    def table() -> str:
        missing = [v.name for v in every if v.name not in scores]
        measured = [scores[v.name] for v in every if v.name in scores]
        return markdown(measured, missing, list(absent.values()))

    tasks = [(name, (variant, sources[variant.action])) for name, variant in chosen.items()]
    for ended in each(one_footage, tasks, jobs, display):
        scores[ended.name] = ended.result or _failed(chosen[ended.name], ended.fault)
        tables.write_texts(folder, {"table.md": table()})
    return table(), folder


def one_footage(display: Display, variant: DegradedAction, source: Path) -> DegradedScore:
    """Bring one footage of an action up to date and score it."""
    shown = ActionDisplay(display, variant.name)
    if not is_made(variant.action_folder, footage_key(source, variant.footage)):
        shown.started("degrade", [f"{variant.footage.degradation.title} is not made"])
        make_footage(variant.action_folder, source, variant.footage)
    job = Workspace(variant.folder).ready_job(str(variant.action_folder), [], shown)
    costs = variant.folder / "costs"
    score = score_action(job, shown, variant.score_file, costs, with_oracle=False)
    return _score(variant, job, score)


def _sources(root: Path) -> tuple[dict[str, Path], dict[str, str]]:
    """Folders of the actions as filmed; and why there is none, of the others."""
    sources, absent = {}, {}
    for action in ACTIONS:
        try:
            folder = data_folder(root, action)
        except WorkFailed as fault:
            absent[action] = str(fault)
            continue
        if (folder / "videos").is_dir():
            sources[action] = folder
        else:
            absent[action] = f"{folder}: expected a folder of videos; IMOCAP_DATA names the data"
    return sources, absent


def _stored(variant: DegradedAction, source: Path) -> DegradedScore | None:
    """Valid numbers, nothing run; None where there are none."""
    key = footage_key(source, variant.footage)
    if not (variant.score_file.is_file() and is_made(variant.action_folder, key)):
        return None
    job = Workspace(variant.folder).job(str(variant.action_folder), [])
    score = cached_score(job, variant.score_file)
    return None if score is None else _score(variant, job, score)


def _score(variant: DegradedAction, job: Job, score: ActionScore) -> DegradedScore:
    stored = job.store.load(job.action.name, "redetect")
    assert stored is not None, "a scored action has its artifacts"
    videos = stored.decode(Redetect).videos
    return DegradedScore(
        variant.action,
        variant.footage,
        variant_score(variant.footage.degradation.title, job, score),
        contradicted=sum(video.contradicted for video in videos),
        moved=sum(int((video.confidence > 0).sum()) for video in videos),
    )


def _failed(variant: DegradedAction, fault: str) -> DegradedScore:
    title = variant.footage.degradation.title
    return DegradedScore(variant.action, variant.footage, VariantScore(title, {}, fault=fault))


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    text, folder = measure(workspace, options.only, options.variants, display, options.jobs)
    return [text, f"Written to {folder}"]
