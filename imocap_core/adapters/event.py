"""One event in all videos: cameras calibrated from the performer, and the motion with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool

from imocap_core.adapters.hints import on_lines
from imocap_core.adapters.joint import JointProblem
from imocap_core.adapters.synchronisation import summary_of
from imocap_core.artifacts.schemas import EventCamera, EventCameras, Keypoints, Sync, SyncSummary
from imocap_core.camera.projection import Lens
from imocap_core.motion import event_rig
from imocap_core.motion.event_calibration import EventCalibration, EventProblem, Progress, calibrate
from imocap_core.motion.event_clock import Clock, clock_of
from imocap_core.motion.multiview.alternation import Alternation, LoopRound, mean_change
from imocap_core.motion.multiview.scene import Cameras, JointMotion, Scene
from imocap_core.motion.multiview.smpl_ba import common_then_deviations
from imocap_core.motion.observations import Observation

MOST_MOMENTS = 300  # of a calibration: of longer videos every second, third, ... moment is used
CORRELATION_S = 0.25  # detector errors count once per this time in the claimed errors
SOUND_SD_S, MATCHES_SD_S = 0.01, 0.2  # of an offset by sound, and by the matches
# Undeclared videos are one event by three quarters of their matches, their paths and their misfit
# under one motion. Recordings of one: 19 to 29 ms, 5 (the least) to 6.8 mm, 0.7 to 1.16 times that
# of several; regular players and walkers: from 19 ms, 5 to 29 mm, 1.25 to 3 times.
ONE_OFFSET_S, ONE_EVENT_PATH_M, MISFIT_RATIO = 0.05, 0.007, 1.2


def _can_calibrate(problem: JointProblem, motion: JointMotion) -> bool:
    """Whether there are several cameras, all are matched, and none moves from its place."""
    moving = any(o.place_sd_m is not None for o in problem.scene.observations)
    matched = all(np.isfinite(m).any() for m in problem.scene.timeline.to_reference)
    several = len(problem.scene.observations) > 1
    return several and motion.common is not None and matched and not moving


def as_one_event(
    problem: JointProblem,
    keypoints: Keypoints,
    loop: Alternation[Sync, SyncSummary, JointMotion],
    progress: Progress,
) -> tuple[Alternation[Sync, SyncSummary, JointMotion], EventCameras | None]:
    """The loop with one more round where its videos look like one event: that of `calibrated_round`
    if its one motion explains them, too; else as it is."""
    last, sync = loop.rounds[loop.best], loop.sync
    problem = problem.synchronised(last.sync)
    alike = _may_be_one_event(problem, last.motion, sync)
    solved = calibrated_round(problem, keypoints, last, sync, progress) if alike else None
    if solved is None or solved[0].rounds[-1].cost > MISFIT_RATIO * last.cost:
        return loop, None
    rounds = [*loop.rounds, solved[0].rounds[-1]]
    event = solved[1].model_copy(update={"declared": False})
    return replace(solved[0], rounds=rounds, best=len(rounds) - 1), event


def _may_be_one_event(problem: JointProblem, motion: JointMotion, sync: Sync) -> bool:
    """Whether the paths are one and most matches near one offset; not under `paper`."""
    spread = motion.spread if problem.options.objective == "shared" else None
    if spread is None or spread.offset_sd[:, 3:].max() > ONE_EVENT_PATH_M:
        return False
    clock = _clock_of_participants(problem, sync)
    for v, m in enumerate(problem.participants.sync(sync).maps):
        matched = np.isfinite(m.reference_frame)
        away = np.arange(len(matched)) - clock.rate[v] * m.reference_frame - clock.offset[v]
        reach = max(1.5, ONE_OFFSET_S * problem.scene.observations[v].fps)  # frames
        if not matched.any() or np.quantile(np.abs(away[matched]), 0.75) > reach:
            return False
    return True


def calibrated_round(
    problem: JointProblem,
    keypoints: Keypoints,
    first: LoopRound[SyncSummary, JointMotion],
    first_sync: Sync,
    progress: Progress,
) -> tuple[Alternation[Sync, SyncSummary, JointMotion], EventCameras] | None:
    """Calibrate the cameras from the event, and fit the motion again with them: the one round after
    the first. None where one camera is alone, unmatched, or moves from its place.

    Args:
        problem: with the correspondences of the first round, whose motion is the start; first_sync:
            the same as a whole.
    """
    sync, motion = first_sync, first.motion
    if not _can_calibrate(problem, motion):
        return None
    names = list(dict.fromkeys(problem.scene.body.keypoints.names))
    clock = _clock_of_participants(problem, sync)
    task, start = _calibration_problem(
        problem, motion, names, clock, _offset_by_sound(problem, sync)
    )
    solved = calibrate(task, start, progress)
    rig = solved.rig.with_lengths_of(task.prior.lengths)
    ids = [video.id for video in problem.participants.keypoints.videos]
    sync = on_lines(sync, replace(clock, offset=rig.offset, rate=rig.rate), ids, keypoints)
    scene = problem.synchronised(sync).scene
    K, R, t = (torch.as_tensor(x).to(motion.cameras.R) for x in (rig.K, rig.R, rig.t))
    cameras = Cameras(R, t, K)
    straight = replace(scene, observations=_undistorted(scene.observations, rig))
    scene = straight.with_intrinsics(cameras)
    begun = scene, motion.state, cameras, replace(problem.options, objective="single"), progress
    again = common_then_deviations(*begun, cameras_known=True)
    before, after = ([m.reference_frame for m in x.maps] for x in (first.sync, sync))
    change = mean_change(before, after)
    status = f"the cameras are calibrated from the event: {solved.status}"
    rounds = [first, LoopRound(summary_of(sync), again, again.misfit, change)]
    step = np.diff(task.moments).min(initial=np.inf) if len(task.moments) > 1 else 1.0
    stored = _stored(ids, scene, solved, float(step))
    return Alternation(rounds, 1, sync, status), stored


def _calibration_problem(
    problem: JointProblem,
    motion: JointMotion,
    names: Sequence[str],
    clock: Clock,
    by_sound: Bool[np.ndarray, " M"],
) -> tuple[EventProblem, event_rig.CameraRig]:
    """The calibration's problem and its start, the keypoints of the motion so far."""
    assert motion.common is not None
    scene, bones = problem.scene_of(motion), event_rig.bones_of(names)
    assumed_K = np.stack([o.K for o in problem.scene.observations])
    observations = scene.observations
    points = scene.body.positions(scene.body.keypoints, motion.common)[0].cpu().numpy()
    columns = [scene.body.keypoints.names.index(name) for name in names]
    moments = np.arange(0, len(points), -(-len(points) // MOST_MOMENTS))
    K, R, t = (x.cpu().numpy() for x in (motion.cameras.K, motion.cameras.R, motion.cameras.t))
    videos = len(observations)
    start = event_rig.CameraRig(
        K, R, t, np.zeros(videos), clock.offset, clock.rate, np.zeros((videos, len(names), 2)),
        points[moments][:, columns], np.zeros(len(bones)),
    )  # fmt: skip
    everywhere = np.ones((len(moments), len(names)), dtype=bool)
    body_lengths = event_rig.typical_lengths(
        event_rig.bone_lengths(start.points, everywhere, bones)
    )
    corrected = [v.lens is not None for v in problem.participants.camera_motion.videos]
    sd_s = np.where(by_sound, SOUND_SD_S, MATCHES_SD_S)
    task = EventProblem(
        videos=[_event_video(o, scene.body.keypoints.names, names) for o in observations],
        moments=moments.astype(float),
        bones=bones,
        reference=scene.reference,
        focal_log_sd=np.array([o.focal_spread for o in observations]),
        alike=np.array([round(float(o.K[:2, 2].max())) for o in observations]),
        prior=replace(start, K=assumed_K, lengths=body_lengths),
        offset_sd=sd_s * [o.fps for o in observations],
        fixed_distortion=np.array(corrected),
    )
    return task, start


def _event_video(
    observation: Observation, columns: Sequence[str], names: Sequence[str]
) -> event_rig.EventVideo:
    """A video's keypoints, one column a name: several layouts have points of one name."""
    weight = observation.confidence / observation.sigma_px[:, None] ** 2
    weight = np.where(np.isfinite(observation.xy_px).all(-1), weight, 0.0)
    frames = len(weight)
    xy_px, merged = np.full((frames, len(names), 2), np.nan), np.zeros((frames, len(names)))
    for column, name in enumerate(columns):
        place = names.index(name)
        better = weight[:, column] > merged[:, place]
        xy_px[better, place] = observation.xy_px[better, column]
        merged[better, place] = weight[better, column]
    return event_rig.EventVideo(xy_px, merged, observation.size_px)


def _undistorted(
    observations: Sequence[Observation], rig: event_rig.CameraRig
) -> list[Observation]:
    rows = zip(observations, rig.K, rig.distortion, strict=True)
    return [replace(o, xy_px=Lens.of([k], K).undistorted(o.xy_px)) if k else o for o, K, k in rows]


def _stored(
    ids: Sequence[str], scene: Scene, solved: EventCalibration, stride: float
) -> EventCameras:
    rig, fps = solved.rig, [o.fps for o in scene.observations]
    together = max(1.0, CORRELATION_S * scene.fps / stride)
    sd = solved.sd * together**0.5  # neighbouring frames err alike
    cameras = [
        EventCamera(
            id=name,
            distortion=float(rig.distortion[v]),
            offset_frames=float(rig.offset[v]),
            rate=float(rig.rate[v]),
            median_px=float(solved.median_px[v]),
            focal_sd=float(sd[v, event_rig.FOCAL]),
            rotation_sd_deg=float(np.degrees(np.linalg.norm(sd[v, event_rig.ROTATION]))),
            offset_sd_s=float(sd[v, event_rig.OFFSET] / fps[v]),
        )
        for v, name in enumerate(ids)
    ]
    return EventCameras(cameras=cameras, status=solved.status)


def _clock_of_participants(problem: JointProblem, sync: Sync) -> Clock:
    """The clock whose lines the correspondences are."""
    matches, observations = problem.participants.sync(sync), problem.scene.observations
    return clock_of(
        [m.reference_frame for m in matches.maps],
        [m.confidence for m in matches.maps],
        [o.fps for o in observations],
        problem.scene.reference,
    )


def _offset_by_sound(problem: JointProblem, sync: Sync) -> Bool[np.ndarray, " M"]:
    """The participants whose offset to the reference is known by their sound."""
    ids = problem.participants.sync(sync).ids
    if sync.sound_start_s is None:
        return np.zeros(len(ids), dtype=bool)
    by_id = dict(zip(sync.ids, np.isfinite(sync.sound_start_s), strict=True))
    return np.array([by_id[i] and by_id[sync.reference] for i in ids])
