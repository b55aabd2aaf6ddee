"""`imocap benchmark wrong_start`: one view's monocular fit is started wrong on purpose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.table import Table

from benchmarks import rendered_action, tables
from benchmarks.actions.captured_videos import DEFAULT_VIDEOS, Choice, video_rng
from benchmarks.actions.prepare import chosen_names, ready_job
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay, each
from benchmarks.scoring import truth_of
from benchmarks.wrong_start_cases import (
    HypothesisRow,
    WrongStart,
    WrongView,
    hypothesis_rows,
    possible_mm,
    wrongly_started,
)
from benchmarks.wrong_start_cases import summary as hypothesis_summary
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    Sync,
    VideoMotion,
)
from imocap_core.artifacts.store import Store, Stored
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.evaluate.scoreboard import StageResult, against_truth
from imocap_core.io.truth import Truth
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace

# The tables of `imocap benchmark wrong_start`.

TITLES = (("From keypoints", False), ("Rendered, from pixels", True))


def markdown(
    rows: Sequence[WrongStartRow], motions: Sequence[HypothesisRow], missing: Sequence[str]
) -> str:
    """The whole report; missing: actions that were to be run and are not in it."""
    if not rows:
        return tables.missing_sentence(missing).strip() + "\n"
    parts = []
    for title, of_pixels in TITLES:
        part = [row for row in rows if rendered_action.is_rendered(row.action) == of_pixels]
        if part:
            among = [row for row in motions if rendered_action.is_rendered(row.action) == of_pixels]
            parts.append(f"{_summary(title, part)}; {hypothesis_summary(among)}.")
    if missing:
        parts.append(tables.missing_sentence(missing).strip())
    return "\n\n".join([*parts, tables.DETAILS, _results(rows)]) + "\n"


def _summary(title: str, rows: Sequence[WrongStartRow]) -> str:
    count = len({row.action for row in rows})
    return f"{title}, {count} {'action' if count == 1 else 'actions'}: {summary(rows)}"


def _results(rows: Sequence[WrongStartRow]) -> str:
    body = [
        [
            row.action,
            row.views,
            row.starts,
            *(
                f"{mm:.1f}"
                for mm in (row.monocular_mm, row.wrong_mm, row.view_mm)
                + (row.undisturbed_mm, row.result_mm)
            ),
            f"{100 * (row.result_mm / row.undisturbed_mm - 1):+.1f}",
            row.excluded or "none",
            row.flipped or "none",
            "yes" if row.recovered else "no",
        ]
        for row in rows
    ]
    head = ["action", "views", "started wrong", "monocular (mm)", "wrong", "after the loop"]
    head += ["all views undisturbed", "all views", "change %", "excluded", "flipped", "recovered"]
    return tables.markdown_table(head, body)


# Every action of trials and rendered, as it is and with one or two views started wrong.

FITS, LAST = "initial_smpl", "refine_sync"
RECOVERED = 1.05  # of the undisturbed error, at most
PURPOSE = 23  # of the random numbers: which views are started wrong
# Of one view, then of two at once.
DISTURBANCES: tuple[tuple[WrongStart, ...], ...] = (
    *(("facing",), ("depth",), ("sides",)),
    *(("facing", "depth"), ("depth", "sides")),
)


@dataclass(frozen=True)
class WrongStartRow:
    """One action with one or two views started wrong; errors are MPJPE, millimetres."""

    action: str
    views: str
    starts: str
    monocular_mm: float  # of these views, undisturbed
    wrong_mm: float  # of these views' wrong fits
    view_mm: float  # of these views after the loop
    undisturbed_mm: float  # of all views after the loop
    result_mm: float  # of all views after the loop
    excluded: str
    flipped: str
    recovered: bool


@dataclass(frozen=True)
class ActionRows:
    """The measurements of one action: results, and the motions among which they were chosen."""

    results: list[WrongStartRow]
    hypotheses: list[HypothesisRow]


def measured_action(
    display: Display, workspace: Workspace, choice: Choice, name: str
) -> ActionRows:
    """One result for each disturbance of an action, of views drawn at random."""
    job = keypoints_alone(undisturbed_job(workspace, choice, name, display), name)
    folder = choice.folder(workspace.root) / "wrong_start"
    plain = replace(job, store=Store(folder / "undisturbed"))
    undisturbed = Undisturbed.of(plain, _run(plain, ActionDisplay(display, name), LAST))
    rows = ActionRows([], undisturbed.hypotheses(undisturbed.initial, undisturbed.sync, "none"))
    for number, starts in enumerate(DISTURBANCES):
        views = drawn_views(name, number, len(job.action.videos), starts)
        if len(views) == len(starts):
            result, hypotheses = _row(undisturbed, folder, views, display)
            rows.results.append(result)
            rows.hypotheses.extend(hypotheses)
    return rows


def names_of(root: Path, choice: Choice) -> list[str]:
    """The actions to run, those of trials and the same rendered; WrongUse for an unknown one."""
    every = chosen_names(root, replace(choice, only=()))
    every += [name + rendered_action.RENDERED for name in every]
    unknown = [name for name in choice.only if name not in every]
    if unknown:
        raise WrongUse(f"--only {unknown[0]}: expected one of {', '.join(every)}")
    return [name for name in every if not choice.only or name in choice.only]


def undisturbed_job(workspace: Workspace, choice: Choice, name: str, display: Display) -> Job:
    """A job of an action, which is made first; WorkFailed when the detector it needs is missing."""
    if not rendered_action.is_rendered(name):
        return ready_job(workspace, choice, name, (), display)
    rendered_action.check_detector(workspace.root)
    rendered = rendered_action.RenderedChoice(min(choice.videos, DEFAULT_VIDEOS))
    return rendered_action.ready_rendered(
        workspace.root, rendered, rendered_action.trial_of(name), ActionDisplay(display, name)
    )


def drawn_views(
    action: str, number: int, count: int, starts: Sequence[WrongStart]
) -> list[WrongView]:
    """As many different videos as there are starts; fewer where an action has too few."""
    rng = video_rng(action, number, PURPOSE)
    videos = [int(rng.integers(count))]
    while len(videos) < min(len(starts), count - 1):
        other = int(rng.integers(count))
        if other not in videos:
            videos.append(other)
    return [WrongView(v, start) for v, start in zip(videos, starts, strict=False)]


def keypoints_alone(job: Job, name: str) -> Job:
    """The job under another name, without the videos' monocular estimates."""
    alone = {"initial": None, "initial_format": None}
    videos = tuple(video.model_copy(update=alone) for video in job.action.videos)
    return replace(job, action=replace(job.action, name=name, videos=videos))


def summary(rows: Sequence[WrongStartRow]) -> str:
    """How many runs were recovered, with one view started wrong and with two."""
    one, two = ([r for r in rows if ("+" in r.starts) == more] for more in (False, True))
    counts = [f"{sum(row.recovered for row in part)} of {len(part)}" for part in (one, two)]
    return (
        f"recovered (nothing excluded or flipped, within 5 %): {counts[0]} with one view started "
        f"wrong, {counts[1]} with two"
    )


def is_recovered(result_mm: float, undisturbed_mm: float, excluded: str, flipped: str) -> bool:
    """No view excluded or flipped, and the result within 5 % of the undisturbed one."""
    return result_mm <= RECOVERED * undisturbed_mm and not excluded and not flipped


@dataclass(frozen=True)
class Undisturbed:
    """An action solved as it is, and its truth."""

    job: Job
    done: dict[str, Stored]
    keypoints: Keypoints
    cameras: CameraMotion
    initial: InitialSmpl
    sync: Sync
    refined: RefineSync
    truth: Truth | None
    possible_mm: list[float]

    @classmethod
    def of(cls, job: Job, done: dict[str, Stored]) -> Undisturbed:
        """Decoded; with the error of each video's fit from its true joints."""
        keypoints, cameras = done["keypoints"].decode(Keypoints), done["camera_motion"]
        truth = truth_of(job, keypoints)
        decoded = cameras.decode(CameraMotion)
        possible = possible_mm(keypoints, decoded, truth, job.settings.params)
        return cls(
            job, done, keypoints, decoded, done[FITS].decode(InitialSmpl),
            done["sync"].decode(Sync), done[LAST].decode(RefineSync), truth, possible,
        )  # fmt: skip

    def hypotheses(self, initial: InitialSmpl, sync: Sync, starts: str) -> list[HypothesisRow]:
        """The motions that each video had, and the choice among them."""
        name = self.job.action.name
        return hypothesis_rows(
            name, starts, self.keypoints, initial, sync, self.truth, self.possible_mm
        )


def _row(
    undisturbed: Undisturbed, folder: Path, views: Sequence[WrongView], display: Display
) -> tuple[WrongStartRow, list[HypothesisRow]]:
    plain, keypoints, initial = undisturbed.job, undisturbed.keypoints, undisturbed.initial
    fits = wrongly_started(keypoints, undisturbed.cameras, initial, views, plain.settings.params)
    starts = "+".join(w.start for w in views)
    label = "_".join(f"{w.start}-{w.video}" for w in views)
    job = replace(plain, store=Store(folder / label))
    shown = ActionDisplay(display, f"{plain.action.name}, {starts}")
    runner.run(job, shown, [s for s in job.pipeline.upstream(FITS) if s != FITS])
    needed = job.recipe(FITS, undisturbed.done)
    job.store.put(FITS, needed.key, fits, needed.provenance(), {})
    done = _run(job, shown, LAST)
    refined, before = done[LAST].decode(RefineSync), undisturbed.refined

    def error_mm(motions: Sequence[VideoMotion], videos: Sequence[int]) -> float:
        of = Keypoints(videos=[keypoints.videos[v] for v in videos])
        result = StageResult("motion", [motions[v] for v in videos])
        return against_truth(result, of, undisturbed.truth)["mpjpe_mm"]

    wrong, every = [w.video for w in views], range(len(keypoints.videos))
    undisturbed_mm = error_mm(before.motion.videos, every)
    result_mm = error_mm(refined.motion.videos, every)
    excluded, flipped = (" ".join(x) for x in (refined.sync.excluded, refined.sync.mirrored))
    row = WrongStartRow(
        action=plain.action.name,
        views=" ".join(keypoints.videos[v].id for v in wrong),
        starts=starts,
        monocular_mm=error_mm(initial.videos, wrong),
        wrong_mm=error_mm(fits.videos, wrong),
        view_mm=error_mm(refined.motion.videos, wrong),
        undisturbed_mm=undisturbed_mm,
        result_mm=result_mm,
        excluded=excluded,
        flipped=flipped,
        recovered=is_recovered(result_mm, undisturbed_mm, excluded, flipped),
    )
    hypotheses = undisturbed.hypotheses(fits, done["sync"].decode(Sync), starts)
    return row, [hypotheses[v] for v in wrong]


def _run(job: Job, display: Display, last: str) -> dict[str, Stored]:
    outcomes = runner.run(job, display, job.pipeline.upstream(last))
    return {outcome.stage: outcome.stored for outcome in outcomes}


NAME = "wrong_start"


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """Results of all actions with how many were recovered, and each video's motions.

    Everything is written after every action; WorkFailed when no action could be measured.
    """
    choice = Choice("trials", options.detector, videos=options.videos, only=options.only)
    names = names_of(workspace.root, choice)
    folder = choice.folder(workspace.root) / NAME
    done: dict[str, ActionRows] = {}
    faults, text = [], ""
    tasks = [(name, (workspace, choice, name)) for name in names]
    for end in each(measured_action, tasks, options.jobs, display):
        if end.result is None:
            faults.append(f"{end.name}: {end.fault}")
            continue
        done[end.name] = end.result
        ordered = [done[name] for name in names if name in done]
        rows = [row for action in ordered for row in action.results]
        motions = [row for action in ordered for row in action.hypotheses]
        text = markdown(rows, motions, [name for name in names if name not in done])
        tables.write_rows(folder, "results", rows)
        tables.write_rows(folder, "motions", motions)
        tables.write_texts(folder, {"table.md": text})
    if not done:
        raise WorkFailed("\n".join(faults))
    return [text, tables.table_of_rows(motions), *faults, f"Written to {folder}"]
