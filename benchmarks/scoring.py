"""The cost of each stage's artifact when it was made, stored so that a cached run can report it.

Measured in this process; a figure depends on the machine and its load at that time.
"""

from __future__ import annotations

import hashlib
import json
import resource
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch

from benchmarks.parallel import ForwardingDisplay
from benchmarks.tables import finite_median
from imocap_core.adapters.joint import problem_of
from imocap_core.adapters.redetection import with_redetected
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    Redetect,
    RefineSync,
    SmplBa,
    Sync,
    SyncMap,
    Uncertainty,
)
from imocap_core.artifacts.schemas.sync_schemas import SyncSummary
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
from imocap_core.metrics.sync import true_reference_frame
from imocap_core.motion.multiview import smpl_ba
from imocap_core.motion.multiview.scene import Cameras, JointMotion, Scene, shared_shapes
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams, Params
from imocap_core.pipeline import runner
from imocap_core.pipeline.action import Action
from imocap_core.pipeline.runner import Display, Job, Outcome
from imocap_core.pipeline.source import closure

STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Cost:
    """Wall time, and the peak of the process's memory in that time."""

    seconds: float
    peak_gb: float


@dataclass
class Meter(ForwardingDisplay):
    """A display that also stores the cost of each stage in `folder`, a file an artifact."""

    folder: Path
    _began: float = field(default=0.0, init=False)

    def started(self, stage: str, why: list[str]) -> None:
        reset_peak()
        self._began = time.perf_counter()
        self.display.started(stage, why)

    def finished(self, outcome: Outcome) -> None:
        if outcome.how == "made":
            self.record(outcome.stored.key, Cost(time.perf_counter() - self._began, peak_gb()))
        self.display.finished(outcome)

    @contextmanager
    def measuring(self, name: str, costs: dict[str, Cost]) -> Iterator[None]:
        """Measure the body of the `with` statement; its cost becomes `costs[name]`."""
        reset_peak()
        began = time.perf_counter()
        yield
        costs[name] = Cost(time.perf_counter() - began, peak_gb())

    def record(self, key: str, cost: Cost) -> None:
        """Store the cost of the artifact with a stage key."""
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / key).write_text(json.dumps([cost.seconds, cost.peak_gb]))

    def costs(self, outcomes: Sequence[Outcome]) -> dict[str, Cost]:
        """Stage -> cost, of the artifacts that were measured when they were made."""
        costs = {}
        for outcome in outcomes:
            with suppress(OSError, ValueError, TypeError):
                written = (self.folder / outcome.stored.key).read_text()
                costs[outcome.stage] = Cost(*json.loads(written))
        return costs


def reset_peak() -> None:
    """Start the peak of memory again from what is in use now, where the system can."""
    with suppress(OSError):
        CLEAR.write_text("5")


def peak_gb() -> float:
    """Peak of memory since `reset_peak`, or since the process began where it can't be reset."""
    with suppress(OSError, StopIteration):
        lines = STATUS.read_text().splitlines()
        return int(next(x for x in lines if x.startswith("VmHWM")).split()[1]) / 2**20
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (2**30 if sys.platform == "darwin" else 2**20)


def cost_sentence(costs: Sequence[Mapping[str, Cost]]) -> str:
    """Total time and peak memory of the stages (each counted where it was measured)."""
    every = [cost for action in costs for cost in action.values()]
    if not every:
        return "Time and memory were not measured."
    seconds, peak = sum(c.seconds for c in every), max(c.peak_gb for c in every)
    return f"All of it took {seconds:.0f} s when it was made, at most {peak:.1f} GB of memory."


# The numbers of one action, and their file.

LAST = "refine_sync"
RESULTS = ("estimator", "monocular", "single pass", "after loop", "oracle")
SINGLE = ("keypoints", "camera_motion", "initial_smpl", "sync", "smpl_ba")
STAGES_OF = {
    "monocular": SINGLE[:3],
    "single pass": SINGLE,
    "after loop": (*SINGLE, "redetect", LAST),
    "oracle": (*SINGLE[:3], "oracle"),
}


def first_videos(count: int) -> str:
    """The name of the loop's result when only the first videos are scored."""
    return f"after loop, first {count}"


@dataclass(frozen=True)
class ActionScore:
    """numbers: result -> metric (docs/metrics.md) -> mean over the videos; costs: stage -> seconds
    and peak gigabytes when it was made."""

    action: str
    videos: int
    frames: int
    numbers: dict[str, dict[str, float]]
    costs: dict[str, Cost]
    key: str

    def of(self, result: str, metric: str) -> float | None:
        """One number, or None where it could not be scored."""
        return self.numbers.get(result, {}).get(metric)

    def cost(self, result: str) -> Cost | None:
        """Cost of a result and all that it is made from; None when a part was not measured."""
        parts = [self.costs.get(stage) for stage in STAGES_OF.get(result, (result,))]
        measured = [part for part in parts if part is not None]
        if len(measured) < len(parts):
            return None
        return Cost(sum(c.seconds for c in measured), max(c.peak_gb for c in measured))


def write_score(score: ActionScore, file: Path) -> None:
    """Store an action's numbers, whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draft = file.with_suffix(".part")
    draft.write_text(json.dumps(asdict(score), indent=1))
    draft.replace(file)


def read_score(file: Path) -> ActionScore | None:
    """An action's stored numbers; None when there are none that can be read."""
    try:
        fields = json.loads(file.read_text())
        costs = {stage: Cost(**cost) for stage, cost in fields.pop("costs").items()}
        return ActionScore(**fields, costs=costs)
    except (FileNotFoundError, ValueError, TypeError, KeyError, AttributeError):
        return None


# The oracle: the same fitter on the same detections with true correspondences and cameras.
#
# It is the bound of every table: a synchronised, calibrated studio with this detector. Only
# correspondences and cameras are taken from the truth.

Value = TypeVar("Value")


def oracle(
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    estimated_sync: SyncSummary,
    truth: Truth,
    params: Params,
) -> tuple[SmplBa, SyncSummary]:
    """The oracle's motion and its correspondences, to the reference video of `estimated_sync`."""
    sync = true_sync(estimated_sync, truth)
    problem = problem_of(keypoints, camera_motion, initial, sync, params.fit, params.motion)
    cameras = true_cameras(sync, truth)
    scene = problem.scene.with_intrinsics(cameras)
    motion = fit_with_cameras(scene, problem.start, cameras, params.motion)
    return replace(problem, scene=scene).result(motion), sync


def fit_with_cameras(
    scene: Scene, start: MotionState, cameras: Cameras, options: MotionParams
) -> JointMotion:
    """The steps of `recover_motion` after its first cameras, with cameras that stay fixed.

    How many metres they are apart tells size as pictures tell proportions, and has its weight.
    """
    if len(scene.observations) == 1:
        return smpl_ba.solve_jointly(scene, start, options)
    scene = replace(scene, fit=replace(scene.fit, size_prior=scene.fit.shape_prior))
    state = shared_shapes(start, scene.performers)
    return smpl_ba.common_then_deviations(scene, state, cameras, options, cameras_known=True)


def true_sync(estimated: SyncSummary, truth: Truth) -> SyncSummary:
    """The true correspondences to the estimate's reference video; NaN for frames without any."""
    reference = _required(truth.videos[estimated.reference].phase, estimated.reference)
    frames = np.arange(len(reference), dtype=np.float64)
    maps = []
    for video in estimated.ids:
        phase = _required(truth.videos[video].phase, video)
        reference_frame = true_reference_frame(phase, frames, reference)
        confidence = np.isfinite(reference_frame).astype(np.float64)
        maps.append(SyncMap(id=video, reference_frame=reference_frame, confidence=confidence))
    true = {"maps": maps, "method": "none", "status": "true"}
    nothing: dict[str, object] = {"excluded": [], "mirrored": [], "notes": [], "trust": None}
    return estimated.model_copy(update=true | nothing)


def true_cameras(sync: SyncSummary, truth: Truth) -> Cameras:
    """The true cameras from the axes of the reference camera."""
    reference = truth.videos[sync.reference]
    R_ref, t_ref = _required(reference.R, sync.reference), _required(reference.t, sync.reference)
    R = [_required(truth.videos[v].R, v) @ R_ref.T for v in sync.ids]
    t = [_required(truth.videos[v].t, v) - R_v @ t_ref for v, R_v in zip(sync.ids, R, strict=True)]
    K = [_required(truth.videos[v].K, v) for v in sync.ids]
    return Cameras(*(torch.as_tensor(np.stack(x)) for x in (R, t, K)))


def _required(value: Value | None, video: str) -> Value:
    if value is None:
        raise ValueError(f"truth of {video}: the oracle needs joints, K, R, t and phase")
    return value


# One action of a benchmark: run its stages, score every result, store the numbers.


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


# Leave-one-out errors of a set of videos, as the benchmarks of real clips sum them up.

PREDICTED = "uncertainty"


@dataclass(frozen=True)
class SetErrors:
    """Medians over a set's videos, in % of the person's height; NaN without any.

    error_pct: of keypoints that the other videos predict; share_10: of those within 10 %.
    monocular_pct: of hidden limbs, by each video's own fit.
    """

    error_pct: float
    share_10: float
    monocular_pct: float


def run_to_prediction(job: Job, display: Display) -> dict[str, Stored]:
    """The artifacts of an action's stages up to the prediction of each video by the others."""
    outcomes = runner.run(job, display, job.pipeline.upstream(PREDICTED))
    return {outcome.stage: outcome.stored for outcome in outcomes}


def set_errors(done: Mapping[str, Stored]) -> SetErrors:
    """The errors of a run."""
    rows = done[PREDICTED].decode(Uncertainty).leave_one_out
    return SetErrors(
        100 * finite_median([row.error_share for row in rows]),
        finite_median([row.near_share for row in rows]),
        100 * finite_median([row.monocular_error_share for row in rows]),
    )
