"""What is cached of an action, what would run and why; actions, parameters and formats listed."""

from __future__ import annotations

import csv
import inspect
import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin, get_type_hints

from annotated_types import Gt, Interval

from imocap_core.artifacts.file_memory import remembered
from imocap_core.errors import ImocapError, WrongUse
from imocap_core.library.api_errors import Params, one_off, plain_errors
from imocap_core.params import Params as AllParams
from imocap_core.pipeline import runner
from imocap_core.pipeline.builtin_actions import BUILT_IN
from imocap_core.pipeline.runner import Job, StageStatus
from imocap_core.pipeline.stage import Recipe
from imocap_core.workspace import Workspace

if TYPE_CHECKING:
    from imocap_core.artifacts.store import Stored


@dataclass(frozen=True)
class Explanation:
    """Everything that a stage's result depends on.

    missing: inputs that have not been made yet; then there is no recipe.
    """

    status: StageStatus
    missing: list[str]
    recipe: Recipe | None


@plain_errors
def status(
    action: str | Path, *, root: str | Path = ".", params: Params = None
) -> list[StageStatus]:
    """For every stage whether its result is cached, and if not, why it would run."""
    workspace = Workspace(Path(root))
    return list(runner.stage_statuses(workspace.job(str(action), one_off(params))))


@plain_errors
def explain(
    action: str | Path, stage: str, *, root: str | Path = ".", params: Params = None
) -> Explanation:
    """Everything that a stage's result depends on, and what has changed since it was made."""
    job = Workspace(Path(root)).job(str(action), one_off(params))
    upstream(job, stage)
    done = {}
    for current in runner.stage_statuses(job):
        if current.stage == stage:
            break
        if current.stored is not None:
            done[current.stage] = current.stored
    missing = [name for name in job.pipeline.stages[stage].inputs if name not in done]
    return Explanation(current, missing, None if missing else job.recipe(stage, done))


@plain_errors
def verdict(
    action: str | Path, *, root: str | Path = ".", params: Params = None
) -> dict[str, Any] | None:
    """The verdict on an action's results as plain data; None where the motion would run again."""
    job = Workspace(Path(root)).job(str(action), one_off(params))
    stored = stored_of(runner.stage_statuses(job))
    if "refine_sync" not in stored:
        return None
    from imocap_core.diagnostics.findings import verdict_document
    from imocap_core.result.artifacts import artifacts_of_stages, verdict_of_artifacts

    judged = verdict_of_artifacts(artifacts_of_stages(job.action.name, stored))
    return None if judged is None else verdict_document(judged)


def report_page(job: Job) -> Path | None:
    """The page of an action's report to open first; the folder itself when it has none."""
    folder = job.store.report(job.action.name)
    for name in ("report.html", "index.html", "index.md"):
        if (folder / name).is_file():
            return folder / name
    return folder if folder.is_dir() else None


def stored_of(statuses: Iterable[StageStatus]) -> dict[str, Stored]:
    """The cached results by stage."""
    return {s.stage: s.stored for s in statuses if s.stored is not None}


def left_out_of(stored: Mapping[str, Stored]) -> dict[str, str]:
    """The videos that these results' keypoints leave out as unusable, and why."""
    result = stored.get("keypoints")
    if result is None or result.schema != "Keypoints":
        return {}

    def read(_: Path) -> dict[str, str]:
        from imocap_core.artifacts.schemas import Keypoints

        return {video.id: video.reason for video in result.decode(Keypoints).left_out or []}

    return remembered("left_out", result.file, read)


def left_out_notes(stored: Mapping[str, Stored]) -> list[str]:
    """A sentence for each of them."""
    return [f"{video} is left out: {reason}" for video, reason in left_out_of(stored).items()]


def upstream(job: Job, stage: str) -> list[str]:
    """A stage and all that it needs, in running order. WrongUse for an unknown stage."""
    if stage not in job.pipeline.stages:
        raise WrongUse(f"no stage {stage!r}; there are: {', '.join(job.pipeline.stages)}")
    return job.pipeline.upstream(stage)


State = Literal["cached", "partly cached", "not run", "not made", "invalid"]
HEADLINE = (  # column of report/summary.csv, and its text
    ("mpjpe_scaled_mm", "scaled MPJPE {:.1f} mm"),
    ("sync_error_pct", "sync error {:.2f} %"),
    ("camera_rotation_error_deg", "cameras {:.1f} deg"),
    ("matched_share", "matched {:.0%}"),
    ("reprojection_px", "reprojection {:.1f} px"),
)
HEADLINE_PARTS = 3


@dataclass(frozen=True)
class ActionSummary:
    """One action.

    state: whether its stages are cached ("not made": built in, made by its first run). videos:
    their number; None unless action.yaml can be read. stages, cached: numbers of stages. headline:
    the figures of its last report. fault: why action.yaml is invalid.
    """

    name: str
    state: State
    videos: int | None = None
    stages: int = 0
    cached: int = 0
    headline: str = ""
    fault: str = ""


@plain_errors
def list_actions(root: str | Path = ".") -> list[ActionSummary]:
    """The actions below root/actions and the built-in ones, by name."""
    workspace = Workspace(Path(root))
    names = {file.parent.name for file in (workspace.root / "actions").glob("*/action.yaml")}
    return [
        _summary(workspace, name) if name in names else ActionSummary(name, "not made")
        for name in sorted({*names, *BUILT_IN})
    ]


def _summary(workspace: Workspace, name: str) -> ActionSummary:
    try:
        job = workspace.job(name, [])
        statuses = list(runner.stage_statuses(job))
    except ImocapError as error:
        return ActionSummary(name, "invalid", fault=str(error))
    cached = sum(status.stored is not None for status in statuses)
    if cached == len(statuses):
        state: State = "cached"
    elif any(job.store.current(job.action.name, s).is_file() for s in job.pipeline.stages):
        state = "partly cached"
    else:
        state = "not run"
    return ActionSummary(
        name,
        state,
        videos=len(job.action.videos),
        stages=len(statuses),
        cached=cached,
        headline=headline_of(job.store.report(job.action.name) / "summary.csv"),
    )


def headline_of(summary: Path) -> str:
    """The main figures of a report's last result; empty when there is no table of them."""
    if not summary.is_file():
        return ""
    with summary.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    if not rows:
        return ""
    values = [(text, _number(rows[-1].get(column))) for column, text in HEADLINE]
    parts = [text.format(value) for text, value in values if value is not None]
    return ", ".join(parts[:HEADLINE_PARTS])


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


NAMES = {float: "number", int: "whole number", str: "text", bool: "true or false"}


@dataclass(frozen=True)
class Parameter:
    """One parameter. value: that in force, or the default; bounds: in words; doc: its meaning."""

    group: str
    name: str
    value: Any
    default: Any
    unit: str
    bounds: str
    doc: str


def parameter_table(group: str | None = None, params: AllParams | None = None) -> list[Parameter]:
    """The parameters of one group, or of all, in order.

    params: whose values are shown, the defaults when None. ValueError for an unknown group; the
    message lists all.
    """
    groups = [f.name for f in fields(AllParams)]
    if group is not None and group not in groups:
        raise ValueError(f"no group of parameters {group!r} (the groups are: {', '.join(groups)})")
    values = params or AllParams()
    wanted = groups if group is None else [group]
    return [row for name in wanted for row in _rows(name, values)]


def group_doc(group: str) -> str:
    """What a group is about, as Markdown."""
    return inspect.cleandoc(type(getattr(AllParams(), group)).__doc__ or "")


def _rows(group: str, params: AllParams) -> Iterator[Parameter]:
    values, defaults = getattr(params, group), getattr(AllParams(), group)
    hints = get_type_hints(type(values), include_extras=True)
    for f in fields(values):
        yield Parameter(
            group=group,
            name=f.name,
            value=getattr(values, f.name),
            default=getattr(defaults, f.name),
            unit=f.metadata["unit"],
            bounds=_bounds(hints[f.name]),
            doc=f.metadata["doc"],
        )


def _bounds(hint: Any) -> str:
    """A type with its bounds in words: "number > 0", "als, svt or none"."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return f"{_bounds(inner[0])} {_limits(inner[1:])}"
    if origin is Literal:
        return f"{', '.join(inner[:-1])} or {inner[-1]}"
    if origin is dict:
        return f"name: {_bounds(inner[1])}"
    if origin is UnionType:
        return " or ".join("null" if part is NoneType else _bounds(part) for part in inner)
    return NAMES[hint]


def _limits(marks: tuple[Any, ...]) -> str:
    """Bounds in words: "> 0", "≥ 1", "from 0 to 1"."""
    (mark,) = marks
    if isinstance(mark, Interval):
        return f"from {mark.ge} to {mark.le}"
    return f"> {mark.gt}" if isinstance(mark, Gt) else f"≥ {mark.ge}"


@plain_errors
def parameters(group: str | None = None, *, root: str | Path = ".") -> list[Parameter]:
    """All parameters, or those of one group, with pipeline.yaml's values; WrongUse for an unknown
    group."""
    return parameter_table(group, Workspace(Path(root)).pipeline().params)


@dataclass(frozen=True)
class Format:
    """A format: what it is of, its name in action.yaml or for --format, what it is."""

    use: Literal["keypoints", "initial", "export"]
    name: str
    what: str


def formats() -> list[Format]:
    """Keypoints and monocular estimates that are read, and exports that are written."""
    from imocap_core.export.formats import WRITERS
    from imocap_core.io.readers.keypoint_readers import ANY_FILE

    anything = {name: f"any of these with the points {layout}" for name, layout in ANY_FILE.items()}
    of = tomllib.loads(Path(__file__).with_name("formats.toml").read_text(encoding="utf-8"))
    return [
        *(Format("keypoints", name, what) for name, what in of["keypoints"].items()),
        *(Format("keypoints", name, what) for name, what in anything.items()),
        *(Format("initial", name, what) for name, what in of["initial"].items()),
        *(Format("export", name, of["export"].get(name, "")) for name in WRITERS),
    ]
