"""One action of a benchmark: run its stages, score every answer, keep the numbers."""

from __future__ import annotations

import hashlib
import json
import resource
from dataclasses import asdict, dataclass
from pathlib import Path

from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    SmplBa,
    Sync,
)
from imocap_core.artifacts.store import Stored
from imocap_core.formats.joints_npz import read_joints_npz
from imocap_core.formats.truth import Truth, read_truth
from imocap_core.metrics.scoring import Motion, over_videos, pose_rows
from imocap_core.views.scoreboard import Answer, against_truth, true_motion
from stages.harness import runner
from stages.harness.action import Action
from stages.harness.errors import WorkFailed
from stages.harness.runner import Display, Job
from stages.harness.source import closure

LAST = "refine_sync"
RESULTS = ("estimator", "monocular", "single pass", "after loop", "oracle")


@dataclass(frozen=True)
class ActionScore:
    """numbers: result -> metric (docs/metrics.md) -> mean over the videos; what it cost."""

    action: str
    videos: int
    frames: int
    numbers: dict[str, dict[str, float]]
    seconds: float  # of the stages that were not cached
    peak_gb: float  # most memory this process has held so far
    key: str

    def of(self, result: str, metric: str) -> float | None:
        """One number, or None where it could not be scored."""
        return self.numbers.get(result, {}).get(metric)


def score_action(job: Job, display: Display, kept: Path) -> ActionScore:
    """Bring the action up to date and score it; numbers kept of the same artifacts stand."""
    outcomes = runner.run(job, display, job.pipeline.upstream(LAST))
    done = {outcome.stage: outcome.stored for outcome in outcomes}
    key = _key(job, done)
    before = _kept(kept)
    if before is not None and before.key == key:
        return before
    keypoints = done["keypoints"].decode(Keypoints)
    score = ActionScore(
        action=job.action.name,
        videos=len(keypoints.videos),
        frames=sum(len(video.frames) for video in keypoints.videos),
        numbers=_numbers(job, done, keypoints),
        seconds=sum(outcome.seconds for outcome in outcomes),
        peak_gb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
        key=key,
    )
    kept.parent.mkdir(parents=True, exist_ok=True)
    draft = kept.with_suffix(".part")
    draft.write_text(json.dumps(asdict(score), indent=1))
    draft.replace(kept)
    return score


def _numbers(
    job: Job, done: dict[str, Stored], keypoints: Keypoints
) -> dict[str, dict[str, float]]:
    from stages.benchmarks.oracle import oracle

    if job.action.truth is None:
        raise WorkFailed(f"{job.action.file}: a benchmark needs truth")
    truth = read_truth(
        job.action.folder / job.action.truth, {v.id: v.frames for v in keypoints.videos}
    )
    camera_motion = done["camera_motion"].decode(CameraMotion)
    initial, sync = done["initial_smpl"].decode(InitialSmpl), done["sync"].decode(Sync)
    single, refined = done["smpl_ba"].decode(SmplBa), done[LAST].decode(RefineSync)
    best, best_sync = oracle(
        keypoints, camera_motion, initial, refined.sync, truth, job.settings.params
    )
    answers = [
        Answer("monocular", initial.videos),
        Answer("single pass", single.videos, single.cameras, sync),
        Answer("after loop", refined.motion.videos, refined.motion.cameras, refined.sync),
        Answer("oracle", best.videos, best.cameras, best_sync),
    ]
    numbers = {answer.name: against_truth(answer, keypoints, truth) for answer in answers}
    started = _estimator(job.action, keypoints, truth)
    return {"estimator": started, **numbers} if started else numbers


def _estimator(action: Action, keypoints: Keypoints, truth: Truth) -> dict[str, float]:
    """What the monocular estimator said before any fit, where there was one."""
    rows = []
    for video in keypoints.videos:
        true = true_motion(truth.videos[video.id], video.frames)
        if video.initial is None or video.initial_format != "joints_npz" or true is None:
            continue
        found = read_joints_npz(action.folder / video.initial, video.frames)
        motion = Motion(found.joints, found.joint_names, video.frames)
        rows += pose_rows("estimator", video.id, motion, true, video.fps)
    return {row.metric: row.value for row in over_videos(rows) if row.value is not None}


def _key(job: Job, done: dict[str, Stored]) -> str:
    truth = b""
    if job.action.truth is not None:
        truth = (job.action.folder / job.action.truth).read_bytes()
    code = [closure(Path(__file__)), closure(Path(__file__).with_name("oracle.py"))]
    told = json.dumps(
        [code, {name: stored.digest for name, stored in done.items()}, job.settings.seed]
    )
    return hashlib.sha256(told.encode() + truth).hexdigest()


def _kept(file: Path) -> ActionScore | None:
    try:
        return ActionScore(**json.loads(file.read_text()))
    except (FileNotFoundError, ValueError, TypeError):
        return None
