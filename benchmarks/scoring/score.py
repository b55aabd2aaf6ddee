"""One action of a benchmark: run its stages, score every result, store the numbers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.scoring.costs import Cost, Meter
from benchmarks.scoring.score_file import LAST, ActionScore, first_videos, read_score, write_score
from imocap_core.adapters.redetection import with_redetected
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    Redetect,
    RefineSync,
    SmplBa,
    Sync,
)
from imocap_core.artifacts.store import Stored
from imocap_core.body import load_free_body
from imocap_core.errors import WorkFailed
from imocap_core.evaluate.scoreboard import (
    StageResult,
    action_truth,
    against_truth,
    body_points,
    true_joints,
)
from imocap_core.evaluate.whole_body_scores import whole_body_rows
from imocap_core.io.readers.estimates import read_joints_npz
from imocap_core.io.truth import Truth
from imocap_core.metrics.scoring import CameraJoints, means_over_videos, pose_rows
from imocap_core.pipeline import runner
from imocap_core.pipeline.action import Action
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.source import closure


def score_action(
    job: Job, display: Display, score_file: Path, costs: Path, *, with_oracle: bool = True
) -> ActionScore:
    """Bring the action up to date and score it, unless its stored numbers are of these artifacts.

    Args:
        score_file: the file of the action's numbers. costs: the folder of the stages' costs.
    """
    meter = Meter(display, costs)
    outcomes = runner.run(job, meter, job.pipeline.upstream(LAST))
    done = {outcome.stage: outcome.stored for outcome in outcomes}
    key = score_key(job, done)
    before = read_score(score_file)
    if before is not None and before.key == key:
        return before
    keypoints = done["keypoints"].decode(Keypoints)
    spent = meter.costs(outcomes)
    score = ActionScore(
        action=job.action.name,
        videos=len(keypoints.videos),
        frames=sum(len(video.frames) for video in keypoints.videos),
        numbers=_numbers(job, done, keypoints, meter, spent, with_oracle),
        costs=spent,
        key=key,
    )
    write_score(score, score_file)
    return score


def cached_score(job: Job | None, score_file: Path, *code: Path) -> ActionScore | None:
    """The stored numbers, if running the job now would change none of its artifacts; else None."""
    before = read_score(score_file)
    if job is None or before is None:
        return None
    done: dict[str, Stored] = {}
    for state in runner.stage_statuses(job):
        if state.stage in job.pipeline.upstream(LAST):
            if state.stored is None:
                return None
            done[state.stage] = state.stored
    return before if before.key == score_key(job, done, *code) else None


def _numbers(
    job: Job,
    done: dict[str, Stored],
    keypoints: Keypoints,
    meter: Meter,
    spent: dict[str, Cost],
    with_oracle: bool,
) -> dict[str, dict[str, float]]:
    truth = truth_of(job, keypoints)
    camera_motion = done["camera_motion"].decode(CameraMotion)
    initial, sync = done["initial_smpl"].decode(InitialSmpl), done["sync"].decode(Sync)
    single, refined = done["smpl_ba"].decode(SmplBa), done[LAST].decode(RefineSync)
    results = [
        StageResult("monocular", initial.videos),
        StageResult("single pass", single.videos, single.cameras, sync),
        StageResult("after loop", refined.motion.videos, refined.motion.cameras, refined.sync),
    ]
    if with_oracle:
        from benchmarks.scoring.oracle import oracle

        evidence = with_redetected(keypoints, camera_motion, done["redetect"].decode(Redetect))
        inputs = (*evidence, initial, refined.sync, truth, job.settings.params)
        with meter.measuring("oracle", spent):
            best, best_sync = oracle(*inputs)
        results.append(StageResult("oracle", best.videos, best.cameras, best_sync))
    model = load_free_body()
    numbers = {
        result.name: _scored(result, keypoints, truth)
        | means_over_videos(whole_body_rows([result], keypoints, truth, model)[0])
        for result in results
    }
    for count in range(1, len(truth.videos)):
        first = Keypoints(videos=keypoints.videos[:count])
        fewer = StageResult(first_videos(count), refined.motion.videos[:count])
        numbers[fewer.name] = _scored(fewer, first, truth)
    estimator = _estimator(job.action, keypoints, truth)
    return {"estimator": estimator, **numbers} if estimator else numbers


def _scored(result: StageResult, keypoints: Keypoints, truth: Truth) -> dict[str, float]:
    """All metrics, with the body's nose where the truth has noses; and the matched share of the
    videos of another action, which the truth leaves out."""
    noses = {}
    if any("nose" in video.joint_names for video in truth.videos.values()):
        model = load_free_body()
        noses = {m.id: body_points(model, m, "coco17", np.eye(3)).nose_m for m in result.motions}
    numbers = against_truth(result, keypoints, truth, noses)
    maps = [] if result.sync is None else result.sync.maps
    outliers = [m.reference_frame for m in maps if truth.videos[m.id].joints is None]
    if outliers:
        numbers["stranger_matched_share"] = float(np.isfinite(np.concatenate(outliers)).mean())
    return numbers


def _estimator(action: Action, keypoints: Keypoints, truth: Truth) -> dict[str, float]:
    """Errors of the monocular estimator before any fit; empty where there is no estimate."""
    rows = []
    for video in keypoints.videos:
        true = true_joints(truth.videos[video.id], video.frames)
        if video.initial is None or video.initial_format != "joints_npz" or true is None:
            continue
        estimate = read_joints_npz(action.folder / video.initial, video.frames)
        motion = CameraJoints(estimate.joints, estimate.joint_names, video.frames)
        rows += pose_rows("estimator", video.id, motion, true, video.fps)
    return means_over_videos(rows)


def truth_of(job: Job, keypoints: Keypoints) -> Truth:
    """The truth of the action's used frames; WorkFailed when the action has none."""
    folder, file = job.action.folder, job.action.truth
    truth = action_truth(folder, None if file is None else folder / file, keypoints)
    if truth is None:
        raise WorkFailed(f"{job.action.file}: a benchmark needs truth")
    return truth


def score_key(job: Job, done: Mapping[str, Stored], *code: Path) -> str:
    """Digest of all that an action's numbers depend on: artifacts, truth, seed, the code of scoring
    and the files of `code`."""
    truth = b"".join((job.action.folder / file).read_bytes() for file in job.action.truth_files)
    files = [closure(file) for file in (Path(__file__), *code)]
    artifacts = {name: stored.digest for name, stored in done.items()}
    parts = json.dumps([files, artifacts, job.settings.seed])
    return hashlib.sha256(parts.encode() + truth).hexdigest()
