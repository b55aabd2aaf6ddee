"""Every action of trials, undisturbed and with one view started wrong, from keypoints alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.actions.captured import video_rng
from benchmarks.actions.choice import Choice
from benchmarks.actions.prepare import ready_job
from benchmarks.parallel import ActionDisplay
from benchmarks.scoring.score import truth_of
from benchmarks.wrong_start.wrong_fit import WRONG_STARTS, WrongStart, wrongly_started
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, RefineSync
from imocap_core.artifacts.store import Store, Stored
from imocap_core.evaluate.results import StageResult
from imocap_core.evaluate.scoreboard import against_truth
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace

FITS, LAST = "initial_smpl", "refine_sync"
RECOVERED = 1.05  # of the undisturbed error, at most
PURPOSE = 23  # of the random numbers: which view is started wrong


@dataclass(frozen=True)
class WrongStartRow:
    """One action with one view started wrong; errors are MPJPE, millimetres."""

    action: str
    view: str
    start: WrongStart
    monocular_mm: float  # of that view, undisturbed
    wrong_mm: float  # of that view's wrong fit
    view_mm: float  # of that view after the loop
    undisturbed_mm: float  # of all views after the loop
    result_mm: float  # of all views after the loop
    excluded: str
    flipped: str
    recovered: bool


def measure_action(
    workspace: Workspace, choice: Choice, name: str, display: Display
) -> list[WrongStartRow]:
    """One row for each wrong start of an action, of a view drawn at random."""
    job = keypoints_alone(ready_job(workspace, choice, name, (), display))
    folder = choice.folder(workspace.root) / "wrong_start"
    plain = replace(job, store=Store(folder / "undisturbed"))
    done = _run(plain, ActionDisplay(display, name), LAST)
    rows = []
    for number, wrong in enumerate(WRONG_STARTS):
        view = int(video_rng(name, number, PURPOSE).integers(len(job.action.videos)))
        rows.append(_row(plain, done, folder, view, wrong, display))
    return rows


def keypoints_alone(job: Job) -> Job:
    """The job without the videos' monocular estimates."""
    alone = {"initial": None, "initial_format": None}
    videos = tuple(video.model_copy(update=alone) for video in job.action.videos)
    return replace(job, action=replace(job.action, videos=videos))


def summary(rows: Sequence[WrongStartRow]) -> str:
    """How many of the wrongly started views were recovered."""
    count = sum(row.recovered for row in rows)
    return f"recovered (nothing excluded or flipped, within 5 %): {count} of {len(rows)}"


def is_recovered(result_mm: float, undisturbed_mm: float, excluded: str, flipped: str) -> bool:
    """No view excluded or flipped, and the result within 5 % of the undisturbed one."""
    return result_mm <= RECOVERED * undisturbed_mm and not excluded and not flipped


def _row(
    plain: Job,
    done: dict[str, Stored],
    folder: Path,
    view: int,
    wrong: WrongStart,
    display: Display,
) -> WrongStartRow:
    keypoints, initial = done["keypoints"].decode(Keypoints), done[FITS].decode(InitialSmpl)
    cameras = done["camera_motion"].decode(CameraMotion)
    params = plain.settings.params
    fits = wrongly_started(keypoints, cameras, initial, view, wrong, params)
    job = replace(plain, store=Store(folder / f"{wrong}-{view}"))
    shown = ActionDisplay(display, f"{plain.action.name}, {wrong}")
    runner.run(job, shown, [s for s in job.pipeline.upstream(FITS) if s != FITS])
    needed = job.recipe(FITS, done)
    job.store.put(FITS, needed.key, fits, needed.provenance(), {})
    refined, before = (d[LAST].decode(RefineSync) for d in (_run(job, shown, LAST), done))
    truth = truth_of(job, keypoints)
    alone = Keypoints(videos=[keypoints.videos[view]])

    def error_mm(motions: list, of: Keypoints) -> float:
        return against_truth(StageResult("motion", motions), of, truth)["mpjpe_mm"]

    undisturbed_mm = error_mm(before.motion.videos, keypoints)
    result_mm = error_mm(refined.motion.videos, keypoints)
    excluded, flipped = (" ".join(x) for x in (refined.sync.excluded, refined.sync.mirrored))
    return WrongStartRow(
        action=plain.action.name,
        view=keypoints.videos[view].id,
        start=wrong,
        monocular_mm=error_mm([initial.videos[view]], alone),
        wrong_mm=error_mm([fits.videos[view]], alone),
        view_mm=error_mm([refined.motion.videos[view]], alone),
        undisturbed_mm=undisturbed_mm,
        result_mm=result_mm,
        excluded=excluded,
        flipped=flipped,
        recovered=is_recovered(result_mm, undisturbed_mm, excluded, flipped),
    )


def _run(job: Job, display: Display, last: str) -> dict[str, Stored]:
    outcomes = runner.run(job, display, job.pipeline.upstream(last))
    return {outcome.stage: outcome.stored for outcome in outcomes}
