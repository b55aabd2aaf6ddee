"""`imocap benchmark lifter`: the 2D to 3D lifter alone."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.actions.captured_videos import Choice
from benchmarks.actions.prepare import action_names, ready_job
from benchmarks.names import BenchmarkOptions
from benchmarks.scoring import truth_of
from imocap_core.adapters.monocular import lifted_joints
from imocap_core.artifacts.schemas import CameraMotion, Keypoints
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WrongUse
from imocap_core.evaluate.scoreboard import true_joints
from imocap_core.io.truth import Truth
from imocap_core.metrics.scoring import CameraJoints, ScoreRow, over_videos, pose_rows
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

# Errors and time of the lifter alone, on motions it was not trained on.
#
# The actions of `trials` and `protocol` with every simulated detector; their simulated monocular
# estimates are not read, the focal length is the pipeline's assumption.

KINDS, LEVELS = ("trials", "protocol"), ("fine_tuned", "generic", "mediapipe")
METRICS = ("mpjpe_mm", "mpjpe_scaled_mm", "pa_mpjpe_mm")
BEST = "best of both"


@dataclass(frozen=True)
class LifterRow:
    """One action, or the mean over a benchmark.

    numbers: errors of the lifter's result. best_pa_mpjpe_mm: P-MPJPE of the better of result and
    alternative (chosen by the truth, per video). latency_ms: processor time per frame.
    """

    benchmark: str
    detector: str
    action: str
    numbers: dict[str, float]
    best_pa_mpjpe_mm: float
    latency_ms: float


def measure(workspace: Workspace, only: Sequence[str], display: Display) -> list[LifterRow]:
    """Every action and their mean for each benchmark and detector; WrongUse for unknown actions."""
    available = {kind: action_names(workspace.root, Choice(kind)) for kind in KINDS}
    every = list(chain(*available.values()))
    for name in only:
        if name not in every:
            raise WrongUse(f"--only {name}: expected one of {', '.join(every)}")
    rows = []
    for kind, level in product(KINDS, LEVELS):
        choice = Choice(kind, level)
        chosen = [name for name in available[kind] if not only or name in only]
        of_choice = [_row(workspace, choice, name, display) for name in chosen]
        rows += [*of_choice, *([_mean(of_choice)] if of_choice else [])]
    return rows


def markdown(rows: Sequence[LifterRow]) -> str:
    """The table."""
    lines = [
        "| data | detections | action | MPJPE | scaled MPJPE | P-MPJPE | better of two, P-MPJPE "
        "| ms a frame |",
        "|---|---|---|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        values = [row.numbers[name] for name in METRICS] + [row.best_pa_mpjpe_mm]
        cells = " | ".join(f"{value:.1f}" for value in values)
        head = f"| {row.benchmark} | {row.detector} | {row.action} |"
        lines.append(f"{head} {cells} | {row.latency_ms:.2f} |")
    return "\n".join(lines) + "\n"


def write_table(rows: Sequence[LifterRow], folder: Path) -> Path:
    """Write the table into a folder; its file."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "table.md"
    file.write_text(markdown(rows), encoding="utf-8")
    return file


def _row(workspace: Workspace, choice: Choice, name: str, display: Display) -> LifterRow:
    job = ready_job(workspace, choice, name, (), display)
    outcomes = runner.run(job, display, job.pipeline.upstream("camera_motion"))
    done = {outcome.stage: outcome.stored for outcome in outcomes}
    keypoints = done["keypoints"].decode(Keypoints)
    cameras = done["camera_motion"].decode(CameraMotion)
    return row_of(choice.name, choice.detector, name, keypoints, cameras, truth_of(job, keypoints))


def row_of(
    benchmark: str,
    detector: str,
    name: str,
    keypoints: Keypoints,
    cameras: CameraMotion,
    truth: Truth,
) -> LifterRow:
    """Lift every video of an action and score the results."""
    rows: list[ScoreRow] = []
    best, seconds, frames = [], 0.0, 0
    for video, camera in zip(keypoints.videos, cameras.videos, strict=True):
        true = true_joints(truth.videos[video.id], video.frames)
        began = time.process_time()
        lifted = lifted_joints(video, camera)
        seconds += time.process_time() - began
        frames += len(video.frames)
        assert lifted is not None
        assert true is not None
        answers = [
            pose_rows(title, video.id, CameraJoints(x, SMPL_JOINTS, video.frames), true, video.fps)
            for title, x in (("lifter", lifted.joints), (BEST, lifted.alternative))
        ]
        rows += answers[0]
        best.append(min(_of(answer)["pa_mpjpe_mm"] for answer in answers))
    latency_ms = 1000 * seconds / frames
    return LifterRow(benchmark, detector, name, _of(rows), float(np.mean(best)), latency_ms)


def _of(rows: Sequence[ScoreRow]) -> dict[str, float]:
    """Metric -> mean over the videos."""
    means = {row.metric: row.value for row in over_videos(rows)}
    return {name: value for name in METRICS if (value := means[name]) is not None}


def _mean(rows: Sequence[LifterRow]) -> LifterRow:
    numbers = {name: float(np.mean([row.numbers[name] for row in rows])) for name in METRICS}
    best = float(np.mean([row.best_pa_mpjpe_mm for row in rows]))
    latency = float(np.mean([row.latency_ms for row in rows]))
    return LifterRow(rows[0].benchmark, rows[0].detector, "**mean**", numbers, best, latency)


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and where it was written."""
    rows = measure(workspace, options.only, display)
    file = write_table(rows, workspace.root / "artifacts" / "benchmark" / "lifter")
    return [markdown(rows), f"Written to {file}"]
