"""What is made of an action's results: exports, films, the viewer, the report, comparisons."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.export.export_options import ExportOptions as ExportOptions
from imocap_core.files import record_made
from imocap_core.library.api_errors import Params, one_off, plain_errors
from imocap_core.library.result import Result, exported, html_file
from imocap_core.library.status import report_page
from imocap_core.pipeline.action import FILE_NAME
from imocap_core.pipeline.generation import generation, run_command
from imocap_core.pipeline.runner import Job
from imocap_core.report.page_files import refresh_pages
from imocap_core.result.artifacts import artifacts_of_stages
from imocap_core.result.result import Time
from imocap_core.workspace import Workspace

if TYPE_CHECKING:
    from imocap_core.compare.compare import Technique, TechniquePair
    from imocap_core.export.formats import Exported
    from imocap_core.film import Film, FilmKind, MotionKind


def output_folder(out: str | Path) -> Path:
    """The folder to write to; WrongUse for an action's, whose videos and keypoints lie there."""
    folder = Path(out)
    for place in (folder.absolute(), folder.absolute().parent):
        made = place.parent.name == "artifacts"  # by the program, for `imocap sync`
        if (place / FILE_NAME).is_file() and not made:
            raise WrongUse(
                f"--out {out}: {place} is an action, whose files might be replaced; choose another "
                f"folder"
            )
    return folder


FILMS, COMPARE = "videos", "compare"


@dataclass(frozen=True)
class Viewer:
    """The pages of an action.

    report: the page of its report; None when it has none. file: the viewer; None when the action
    lacks results for one. written: False when the file was up to date.
    """

    action: str
    report: Path | None
    file: Path | None
    written: bool


@dataclass(frozen=True)
class ActionComparison:
    """How the performances of an action differ, or two actions; and the files that say so."""

    technique: Technique | None
    pair: TechniquePair | None
    files: list[Path]


def result_of(action: str | Path, root: str | Path = ".", params: Params = None) -> Result:
    """The result of an action's files and parameters as they are now, by its name or folder.

    WorkFailed, with the command that mends it, when the results are of something else.
    """
    sets = one_off(params)
    return _current(_job(action, root, sets), sets)


@plain_errors
def export(
    action: str | Path,
    out: str | Path,
    *,
    format: str = "npz",
    up: str | None = None,
    time: Time = "own",
    options: ExportOptions | None = None,
    root: str | Path = ".",
    params: Params = None,
    announce: Callable[[str], None] = lambda step: None,
) -> Exported:
    """Write an action's motion, cameras and correspondences; arguments as of `Result.export`.

    options: what of it is written, where its origin is, as what character.

    params: those that the result was made with, as of `run`.

    announce: called before a slow step: the installation of Blender, for fbx and usd.
    """
    from imocap_core.export.formats import DEFAULT, check_format

    check_format(format, up)
    (options or DEFAULT).check(format)
    result = result_of(action, root, params)
    return exported(result, format, output_folder(out), up, time, options, announce)


@plain_errors
def angles(
    action: str | Path, out: str | Path, *, root: str | Path = ".", params: Params = None
) -> Exported:
    """Write the joint angles of an action by ISB's recommendations, as CSV tables and a figure.

    params: those that the result was made with, as of `run`.
    """
    from imocap_core.export.angles import export_angles

    return export_angles(result_of(action, root, params), output_folder(out))


@plain_errors
def films(
    action: str | Path,
    *,
    kind: FilmKind = "both",
    mesh: bool = True,
    motion: MotionKind = "final",
    opacity: float = 0.75,
    span: tuple[float, float] | None = None,
    root: str | Path = ".",
    params: Params = None,
) -> tuple[list[Film], Path]:
    """The films of an action, to be written by `write_films`, and the usual folder for them.

    span: seconds of the common time, from and to: one film of all videos, of that part.
    """
    from imocap_core.film import films_of

    sets = one_off(params)
    job = _job(action, root, sets)
    made = films_of(
        _current(job, sets), kind, mesh=mesh, motion=motion, opacity=opacity, span_s=span
    )
    return made, job.store.folder / job.action.name / FILMS


@plain_errors
def write_films(
    films: Sequence[Film], folder: str | Path, advance: Callable[[Film, int], None]
) -> list[Path]:
    """Write films; `advance(film, frames done)` is called after each frame."""
    from imocap_core.film import write_films as write

    return write(films, Path(folder), advance)


@plain_errors
def view(
    action: str | Path,
    out: str | Path | None = None,
    *,
    small: bool = False,
    root: str | Path = ".",
    params: Params = None,
    progress: Callable[[float, str], None] = lambda share, what: None,
) -> Viewer:
    """Write the viewer of an action, one HTML file that needs nothing else.

    Args:
        out: the .html file; else viewer.html in its report.
        small: with fewer and smaller pictures, for a phone.
        params: those that the result was made with, as of `run`.
        progress: a function of (share, text).
    """
    from imocap_core.viewer.viewer_scene import FILE_NAME, can_be_viewed, write_viewer

    sets = one_off(params)
    job = _job(action, root, sets)
    name, page = job.action.name, report_page(job)
    file = job.store.report(name) / FILE_NAME if out is None else html_file(out)
    possible = can_be_viewed(job.store, name)
    if page is None and not possible:
        raise WorkFailed(f"{action} has no report yet; make one with: imocap run {action}")
    if out is None and not possible:
        return Viewer(name, page, None, False)
    if out is not None:
        return Viewer(name, page, file, write_viewer(_current(job, sets), file, progress, small))
    with job.store.lock(name, lambda: progress(0.0, "a run of this action is at work; waiting")):
        written = write_viewer(_current(job, sets), file, progress, small)
        record_made(file.parent, [file.name])
        refresh_pages(job.store, name)
    return Viewer(name, page, file, written)


@plain_errors
def report(action: str | Path, *, root: str | Path = ".", params: Params = None) -> Path:
    """Make the page of an action from its results; its path."""
    from imocap_core.report.action_report import NEEDED, bring_up_to_date, complete

    sets = one_off(params)
    job = _job(action, root, sets)
    with job.store.lock(job.action.name, lambda: None):
        stored = generation(job, sets, scored=True)
        if not complete(stored):
            missing = ", ".join(stage for stage in NEEDED if stage not in stored) or "its stages"
            raise WorkFailed(
                f"{job.action.name}: the results of {missing} are missing; make them with: "
                f"{run_command(job, [])}"
            )
        return bring_up_to_date(job, stored)


@plain_errors
def compare(
    action: str | Path,
    second: str | Path | None = None,
    *,
    out: str | Path | None = None,
    root: str | Path = ".",
    params: Params = None,
) -> ActionComparison:
    """Technique: what performances of an action share and how they differ; or two performers.

    Where action.yaml declares several performers, every two of them are compared.

    Args:
        second: the action of another performer.
        out: folder to write to; else artifacts/ACTION/report/compare.
    """
    import numpy as np

    from imocap_core.compare.compare import (
        describe,
        pair_of,
        performances_of,
        performers_of,
        several,
    )
    from imocap_core.compare.technique_report import write_pair, write_technique

    sets = one_off(params)
    job = _job(action, root, sets)
    name = job.action.name
    folder = job.store.report(name) / COMPARE if out is None else output_folder(out)
    result = _current(job, sets)
    if second is None and len(performers_of(result)) > 1:
        pairs, files = _performers_compared(result, folder)
        return _compared(job, ActionComparison(None, pairs[0], files), out)
    first = performances_of(result)
    if second is None:
        technique = describe(several(first))
        files = write_technique(folder, technique, {v.id: v for v in result})
        return _compared(job, ActionComparison(technique, None, files), out)
    other = _job(second, root, []).action.name
    if other == name:
        raise WrongUse(f"{name} and {second} are one action; leave the second out")
    pair = pair_of(
        describe(first),
        describe(performances_of(result_of(second, root, params), first.shaped)),
        job.settings.params.sync,
        np.random.default_rng(job.settings.seed),
    )
    files = write_pair(folder if out else folder / other, pair)
    return _compared(job, ActionComparison(None, pair, files), out)


def _performers_compared(result: Result, folder: Path) -> tuple[list[TechniquePair], list[Path]]:
    """Every two performers of one action, each two in a folder of their own where there are more
    than two; on the body of the reference."""
    from imocap_core.compare.compare import (
        describe,
        pair_on_one_axis,
        performances_of,
        performers_of,
    )
    from imocap_core.compare.technique_report import write_pair

    names = performers_of(result)
    of = {name: describe(performances_of(result, performer=name)) for name in names}
    pairs, files = [], list[Path]()
    for a, b in combinations(names, 2):
        pairs.append(pair_on_one_axis(of[a], of[b]))
        files += write_pair(folder if len(names) == 2 else folder / f"{a}-{b}", pairs[-1])
    return pairs, files


def _compared(job: Job, made: ActionComparison, out: str | Path | None) -> ActionComparison:
    """The same, its files recorded where they belong to the report."""
    if out is None:
        report = job.store.report(job.action.name)
        record_made(report, (file.relative_to(report).as_posix() for file in made.files))
        refresh_pages(job.store, job.action.name)
    return made


def _job(action: str | Path, root: str | Path, sets: list[str]) -> Job:
    return Workspace(Path(root)).job(str(action), sets)


def _current(job: Job, sets: list[str]) -> Result:
    from imocap_core.result.read import read_result

    stored = generation(job, sets)
    artifacts = artifacts_of_stages(
        job.action.name, stored, f"run it with: {run_command(job, sets)}"
    )
    return read_result(artifacts, Result, job.action.folder)
