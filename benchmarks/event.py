"""`imocap benchmark event`: cameras calibrated from a performer whom they all film at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from rich.table import Table

from benchmarks.actions.captured_videos import data_folder
from benchmarks.actions.event_films import make_event
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay
from benchmarks.scoring import truth_of
from benchmarks.tables import table_of_rows, write_rows
from imocap_core.artifacts.schemas import CameraMotion, Keypoints, RefineSync
from imocap_core.body import load_free_body
from imocap_core.errors import WrongUse
from imocap_core.evaluate.action_scores import score_results
from imocap_core.evaluate.scoreboard import AFTER_LOOP, StageResult
from imocap_core.metrics.scoring import over_videos
from imocap_core.metrics.trajectory import camera_place_errors_mm, camera_rotation_error_deg
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

# One event through the pipeline, and how far its cameras are from the true ones.

LAST, TRIAL = "refine_sync", 0
EVENTS = ("cmu_soccer_kick_s10", "cmu_jump_s13", "tennis_forehand_jpcardona", "tennis_serve_jarua")


@dataclass(frozen=True)
class EventErrors:
    """Mean over the videos.

    rotation_deg: against the reference's camera. place_mm: of the cameras, after one similarity.
    focal_pct, offset_frames: mean absolute errors. claimed: root mean square of errors over claimed
    standard deviations, of rotations, focal lengths and offsets together; 1 when honest.
    """

    event: str
    rotation_deg: float
    place_mm: float
    focal_pct: float
    offset_frames: float
    claimed: float
    mpjpe_scaled_mm: float
    pa_mpjpe_mm: float


def event_errors(display: Display, root: Path, name: str) -> EventErrors:
    """An action of `trials`, one performance of it filmed by four cameras; made and run."""
    folder = root / "artifacts" / "benchmark" / "event"
    action = folder / "actions" / name
    make_event(action, data_folder(root, "trials") / f"{name}.npz", TRIAL)
    shown = ActionDisplay(display, name)
    job = Workspace(folder).ready_job(str(action), [], shown)
    done = {o.stage: o.stored for o in runner.run(job, shown, job.pipeline.upstream(LAST))}
    keypoints, cameras = (
        done["keypoints"].decode(Keypoints),
        done["camera_motion"].decode(CameraMotion),
    )
    refined = done[LAST].decode(RefineSync)
    with np.load(action / "truth.npz") as stored:
        truth = {key: stored[key] for key in stored.files}
    result = StageResult(AFTER_LOOP, refined.motion.videos, refined.motion.cameras, refined.sync)
    rows = score_results([result], keypoints, cameras, truth_of(job, keypoints), load_free_body())
    means = {row.metric: row.value for row in over_videos(rows)}
    scores = [float(means[m] or np.nan) for m in ("mpjpe_scaled_mm", "pa_mpjpe_mm")]
    return EventErrors(name, *_camera_errors(refined, truth, keypoints.videos[0].fps), *scores)


def _camera_errors(
    refined: RefineSync, truth: dict[str, Float[np.ndarray, "..."]], fps: float
) -> tuple[float, float, float, float, float]:
    ids = [camera.id for camera in refined.motion.cameras]
    K, R, t = (np.stack([getattr(c, part) for c in refined.motion.cameras]) for part in "KRt")
    true_K, true_R, true_t = (np.stack([truth[f"{i}/{part}"] for i in ids]) for part in "KRt")
    reference = ids.index(refined.sync.reference)
    others = [v for v in range(len(ids)) if v != reference]
    turned = camera_rotation_error_deg(R, R[reference], true_R, true_R[reference])[others]
    centres, true_centres = (-np.einsum("mji,mj->mi", a, b) for a, b in ((R, t), (true_R, true_t)))
    place_mm = camera_place_errors_mm(centres, true_centres)
    focal = np.log(K[:, 0, 0] / true_K[:, 0, 0])
    phases = [truth[f"{i}/phase"] for i in ids]
    true_offset = np.array([phases[reference][0] - phase[0] for phase in phases])
    assert refined.event is not None, "the action is declared one event"
    event = refined.event.cameras
    offset = np.array([c.offset_frames for c in event]) - true_offset
    claims = [
        turned / [event[v].rotation_sd_deg for v in others],
        focal / [c.focal_sd for c in event],
        offset[others] / [event[v].offset_sd_s * fps for v in others],
    ]
    claimed = float(np.sqrt(np.mean(np.concatenate(claims) ** 2)))
    return (
        float(turned.mean()),
        float(place_mm.mean()),
        100 * float(np.abs(focal).mean()),
        float(np.abs(offset[others]).mean()),
        claimed,
    )


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """Every event (`--only NAME` for some), declared as one."""
    for name in options.only:
        if name not in EVENTS:
            raise WrongUse(f"--only {name}: expected one of {', '.join(EVENTS)}")
    rows = []
    for name in options.only or EVENTS:
        rows.append(event_errors(display, workspace.root, name))
    folder = workspace.root / "artifacts" / "benchmark" / "event"
    write_rows(folder, "events", rows)
    return [table_of_rows(rows), f"Written to {folder}"]
