"""One action of a benchmark: run its stages, score every answer, keep the numbers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.scoring.costs import Cost, Meter
from benchmarks.scoring.score_file import LAST, ActionScore, first_videos, keep_score, read_score
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    SmplBa,
    Sync,
)
from imocap_core.artifacts.store import Stored
from imocap_core.body import load_free_body
from imocap_core.errors import WorkFailed
from imocap_core.evaluate.scoreboard import StageResult, against_truth, true_motion
from imocap_core.figures.bodies import body_points
from imocap_core.io.estimators.joints_npz import read_joints_npz
from imocap_core.io.truth import Truth, read_truth
from imocap_core.metrics.scoring import CameraJoints, over_videos, pose_rows
from imocap_core.pipeline import runner
from imocap_core.pipeline.action import Action
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.source import closure


def score_action(
    job: Job, display: Display, kept: Path, costs: Path, *, with_oracle: bool = True
) -> ActionScore:
    """Bring the action up to date and score it; numbers kept of the same artifacts stand.

    Args:
        kept: the file of the action's numbers. costs: the folder where costs of stages are kept.
    """
    meter = Meter(display, costs)
    outcomes = runner.run(job, meter, job.pipeline.upstream(LAST))
    done = {outcome.stage: outcome.stored for outcome in outcomes}
    key = score_key(job, done)
    before = read_score(kept)
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
    keep_score(score, kept)
    return score


def standing_score(job: Job | None, kept: Path, *code: Path) -> ActionScore | None:
    """The numbers kept, if running the job now would change none of its artifacts; else None."""
    before = read_score(kept)
    if job is None or before is None:
        return None
    done: dict[str, Stored] = {}
    for standing in runner.standings(job):
        if standing.stage in job.pipeline.upstream(LAST):
            if standing.stored is None:
                return None
            done[standing.stage] = standing.stored
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
    answers = [
        StageResult("monocular", initial.videos),
        StageResult("single pass", single.videos, single.cameras, sync),
        StageResult("after loop", refined.motion.videos, refined.motion.cameras, refined.sync),
    ]
    if with_oracle:
        from benchmarks.scoring.oracle import oracle

        given = (keypoints, camera_motion, initial, refined.sync, truth, job.settings.params)
        with meter.measuring("oracle", spent):
            best, best_sync = oracle(*given)
        answers.append(StageResult("oracle", best.videos, best.cameras, best_sync))
    numbers = {answer.name: _scored(answer, keypoints, truth) for answer in answers}
    for count in range(1, len(truth.videos)):
        seen = Keypoints(videos=keypoints.videos[:count])
        fewer = StageResult(first_videos(count), refined.motion.videos[:count])
        numbers[fewer.name] = _scored(fewer, seen, truth)
    started = _estimator(job.action, keypoints, truth)
    return {"estimator": started, **numbers} if started else numbers


def _scored(answer: StageResult, keypoints: Keypoints, truth: Truth) -> dict[str, float]:
    """All metrics, the nose posed with the body where the truth knows noses; and how much of the
    videos that the truth does not know was matched all the same."""
    noses = {}
    if any("nose" in video.joint_names for video in truth.videos.values()):
        model = load_free_body()
        noses = {m.id: body_points(model, m, "coco17", np.eye(3)).nose_m for m in answer.motions}
    numbers = against_truth(answer, keypoints, truth, noses)
    maps = [] if answer.sync is None else answer.sync.maps
    strangers = [m.reference_frame for m in maps if truth.videos[m.id].joints is None]
    if strangers:
        numbers["stranger_matched_share"] = float(np.isfinite(np.concatenate(strangers)).mean())
    return numbers


def _estimator(action: Action, keypoints: Keypoints, truth: Truth) -> dict[str, float]:
    """What the monocular estimator said before any fit, where there was one."""
    rows = []
    for video in keypoints.videos:
        true = true_motion(truth.videos[video.id], video.frames)
        if video.initial is None or video.initial_format != "joints_npz" or true is None:
            continue
        found = read_joints_npz(action.folder / video.initial, video.frames)
        motion = CameraJoints(found.joints, found.joint_names, video.frames)
        rows += pose_rows("estimator", video.id, motion, true, video.fps)
    return {row.metric: row.value for row in over_videos(rows) if row.value is not None}


def truth_of(job: Job, keypoints: Keypoints) -> Truth:
    """The truth of the action's used frames; WorkFailed when it has none."""
    if job.action.truth is None:
        raise WorkFailed(f"{job.action.file}: a benchmark needs truth")
    used = {video.id: video.frames for video in keypoints.videos}
    return read_truth(job.action.folder / job.action.truth, used)


def score_key(job: Job, done: Mapping[str, Stored], *code: Path) -> str:
    """Digest of all that an action's numbers depend on; `code` besides the scoring's own."""
    truth = b""
    if job.action.truth is not None:
        truth = (job.action.folder / job.action.truth).read_bytes()
    files = [closure(file) for file in (Path(__file__), *code)]
    artifacts = {name: stored.digest for name, stored in done.items()}
    told = json.dumps([files, artifacts, job.settings.seed])
    return hashlib.sha256(told.encode() + truth).hexdigest()
