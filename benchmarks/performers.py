"""`imocap benchmark performers`: one action by two performers, each with a body of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.actions.captured_videos import data_folder
from benchmarks.actions.performers import (
    LIMBS,
    PERFORMERS,
    bone_lengths_m,
    limb_lengths_m,
    performances,
    ready_performers,
)
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay
from benchmarks.scoring import truth_of
from benchmarks.tables import cell, markdown_table, table_of_rows, write_rows, write_texts
from imocap_core.artifacts.schemas import Keypoints, RefineSync
from imocap_core.body import load_free_body
from imocap_core.evaluate.scoreboard import StageResult, against_truth
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace

# Both performers together, declared and not, and each alone.

LAST = "refine_sync"
RUNS = ("declared", "not declared", "alone")


@dataclass(frozen=True)
class PerformerRow:
    """One performer in one run. Errors: MPJPE (scaled) and after Procrustes alignment, mm; mean
    error of the limbs' proportions, %; of the cameras, degrees."""

    run: str
    performer: str
    mpjpe_scaled_mm: float
    pa_mpjpe_mm: float
    proportions_pct: float
    camera_deg: float


def measured(
    root: Path, files: Sequence[Path], videos: int, detector: str, display: Display
) -> list[PerformerRow]:
    """Rows of every run and performer."""
    job = ready_performers(root, files, videos, detector, display)
    names = {v.id: PERFORMERS[i // videos] for i, v in enumerate(job.action.videos)}
    lengths = _true_lengths(files, videos)
    rows = []
    for run in RUNS:
        for group in [[name] for name in PERFORMERS] if run == "alone" else [list(PERFORMERS)]:
            one = _job_of(job, names, group, declared=run == "declared")
            rows += _rows(one, run, names, lengths, ActionDisplay(display, one.action.name))
    return rows


def _job_of(job: Job, names: dict[str, str], performers: list[str], *, declared: bool) -> Job:
    """The job of some performers' videos alone."""
    videos = tuple(
        video.model_copy(update={"performer": names[video.id] if declared else None})
        for video in job.action.videos
        if names[video.id] in performers
    )
    word = "declared" if declared else "".join(performers)
    name = f"{job.action.name}-{word}"
    return replace(job, action=replace(job.action, name=name, videos=videos))


def _rows(
    job: Job,
    run: str,
    names: dict[str, str],
    lengths: dict[str, dict[str, float]],
    display: Display,
) -> list[PerformerRow]:
    outcomes = runner.run(job, display, job.pipeline.upstream(LAST))
    done = {outcome.stage: outcome.stored for outcome in outcomes}
    keypoints, refined = done["keypoints"].decode(Keypoints), done[LAST].decode(RefineSync)
    truth = truth_of(job, keypoints)
    rows = []
    for performer in dict.fromkeys(names[v.id] for v in keypoints.videos):
        index = [i for i, v in enumerate(keypoints.videos) if names[v.id] == performer]
        shown = Keypoints(videos=[keypoints.videos[i] for i in index])
        motions = [refined.motion.videos[i] for i in index]
        poses = against_truth(StageResult("motion", motions), shown, truth)
        whole = StageResult("all", refined.motion.videos, refined.motion.cameras, refined.sync)
        scores = against_truth(whole, keypoints, truth)
        betas = [motion.betas for motion in motions]
        rows.append(
            PerformerRow(
                run,
                performer,
                poses["mpjpe_scaled_mm"],
                poses["pa_mpjpe_mm"],
                proportions_error_pct(betas, lengths[performer]),
                scores.get("camera_rotation_error_deg", float("nan")),
            )
        )
    return rows


def proportions_error_pct(betas: Sequence[np.ndarray], true_m: dict[str, float]) -> float:
    """Mean error of the limbs' lengths relative to each other, in % of a length."""
    model = load_free_body()
    errors = []
    for shape in betas:
        lengths = bone_lengths_m(model, shape)
        ratio = np.log([lengths[bone] / true_m[bone] for bone in LIMBS])
        errors.append(np.abs(ratio - ratio.mean()).mean())
    return float(100 * np.mean(errors))


def _true_lengths(files: Sequence[Path], videos: int) -> dict[str, dict[str, float]]:
    captured = performances(files, videos)
    return {
        name: limb_lengths_m(captured[i * videos].joints_m) for i, name in enumerate(PERFORMERS)
    }


NAME = "performers"
FILES = (("trials", "cmu_walk_s07"), ("performers", "cmu_walk_s08"))  # of the two performers
VIDEOS = 3  # of each
HEAD = (
    *("run", "performer", "MPJPE scaled (mm)", "P-MPJPE (mm)", "limbs' proportions (%)"),
    "cameras (deg)",
)


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """A row for every run and performer, and the means of the runs."""
    files = [data_folder(workspace.root, kind) / f"{name}.npz" for kind, name in FILES]
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    rows = measured(folder, files, VIDEOS, options.detector, display)
    text = markdown(rows)
    write_rows(folder, "results", rows)
    write_texts(folder, {"table.md": text})
    return [table_of_rows(rows), summary(rows), f"Written to {folder}"]


def markdown(rows: Sequence[PerformerRow]) -> str:
    """The summary and the table."""
    cells = [
        [
            row.run,
            row.performer,
            cell(row.mpjpe_scaled_mm, 1),
            cell(row.pa_mpjpe_mm, 1),
            cell(row.proportions_pct, 2),
            cell(row.camera_deg, 1),
        ]
        for row in rows
    ]
    return f"{summary(rows)}\n\n{markdown_table(HEAD, cells)}\n"


def summary(rows: Sequence[PerformerRow]) -> str:
    """Means over the performers of every run."""
    parts = []
    for run in RUNS:
        of_run = [row for row in rows if row.run == run]
        error = np.mean([row.mpjpe_scaled_mm for row in of_run])
        shape = np.mean([row.proportions_pct for row in of_run])
        parts.append(f"{run} {error:.1f} mm and {shape:.1f} %")
    return f"Mean scaled MPJPE and error of the limbs' proportions: {'; '.join(parts)}."
