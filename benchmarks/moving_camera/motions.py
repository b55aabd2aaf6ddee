"""Yoga with cameras that turn, that walk, and that walk along an unknown path: all through the
pipeline, from given keypoints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.moving_camera.action import CENTRES, WALKS, make_moving_yoga
from benchmarks.parallel import ActionDisplay
from benchmarks.scoring.score import truth_of
from imocap_core.adapters.relative_motion import Paths, paths_of, paths_of_initial
from imocap_core.alignment import rigid
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, RefineSync
from imocap_core.body import load_free_body
from imocap_core.evaluate.action_scores import score_results
from imocap_core.evaluate.scoreboard import AFTER_LOOP, StageResult
from imocap_core.metrics.scoring import over_videos
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

SEEDS = (31, 32)  # of performer, motion and cameras; defaults were chosen on others
METRICS = (
    "mpjpe_mm", "pa_mpjpe_mm", "w_mpjpe_mm", "root_path_error_mm", "foot_sliding_mm",
    "camera_rotation_error_deg", "reprojection_px",
)  # fmt: skip
CASES = ("turns", "one walks", "all walk", "all walk, paths unknown")
LAST = "refine_sync"
ONE = 0  # the video whose camera walks alone


@dataclass(frozen=True)
class MotionRow:
    """One action: its results after the loop, mean over its videos.

    path_mm: root mean square error of the metric paths, rigidly aligned, over the walking cameras;
    unit_pct: mean absolute error of their units; NaN without paths.
    """

    seed: int
    case: str
    numbers: dict[str, float]
    path_mm: float
    unit_pct: float


def motion_row(display: Display, root: Path, seed: int, case: str) -> MotionRow:
    """One action of a seed, made and run."""
    walks = {} if case == "turns" else {ONE: WALKS[ONE]} if case == "one walks" else dict(
        enumerate(WALKS)
    )  # fmt: skip
    folder = root / "artifacts" / "benchmark" / "moving_camera"
    name = f"yoga{seed}_{'_'.join(str(v) for v in sorted(walks)) or 'turns'}"
    action = folder / "actions" / name
    make_moving_yoga(action, seed, walks)
    sets = ["camera_motion.structure=false"] if case.endswith("unknown") else []
    shown = ActionDisplay(display, f"{name}, {case}")
    job = Workspace(folder).ready_job(str(action), sets, shown)
    done = {o.stage: o.stored for o in runner.run(job, shown, job.pipeline.upstream(LAST))}
    keypoints = done["keypoints"].decode(Keypoints)
    cameras, motion = done["camera_motion"].decode(CameraMotion), done[LAST].decode(RefineSync)
    solved = motion.motion
    result = StageResult(
        AFTER_LOOP, solved.videos, solved.cameras, motion.sync, paths_of(solved.cameras)
    )
    truth = truth_of(job, keypoints)
    rows = score_results([result], keypoints, cameras, truth, load_free_body())
    means = {row.metric: row.value for row in over_videos(rows)}
    paths = paths_of_initial(done["initial_smpl"].decode(InitialSmpl), cameras)
    error, unit = _path_errors(paths, action / CENTRES)
    return MotionRow(seed, case, {m: _number(means.get(m)) for m in METRICS}, error, unit)


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _path_errors(paths: Paths, centres: Path) -> tuple[float, float]:
    """Of the cameras whose path is known, by their true places."""
    errors, units = [], []
    with np.load(centres) as true:
        for video, path in paths.items():
            fit = rigid(path, true[video])
            off = path @ fit.R_target_from_source.T + fit.t_target - true[video]
            errors.append(1000 * float(np.sqrt((off**2).sum(axis=1).mean())))
            lengths = [float(np.linalg.norm(x - x.mean(axis=0))) for x in (path, true[video])]
            units.append(100 * abs(lengths[0] / lengths[1] - 1))
    return (float(np.mean(errors)), float(np.mean(units))) if errors else (np.nan, np.nan)
