"""The joint motion's problem: from artifacts to what SMPL-BA solves, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.adapters import hypotheses
from imocap_core.adapters.observations import (
    body_for,
    estimated_joints,
    fit_of,
    joint_motion_of,
    observations_of,
    smpl_ba_of,
    state_of,
)
from imocap_core.adapters.participants import Participants, participants_of
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    SmplBa,
    SyncMap,
    SyncSummary,
)
from imocap_core.motion.monocular.fit import Progress
from imocap_core.motion.multiview.scene import JointMotion, Scene
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.motion.multiview.timeline import BeyondReference, make_timeline
from imocap_core.motion.observations import Observation, from_one_place
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body, MotionState
from imocap_core.params import FitParams, MotionParams
from imocap_core.sync.warp.reprojection_evidence import CalibratedVideo, ReprojectionEvidence

# Deviations of one motion, in metres (training clips resampled: up to 0.005 and 0.005; captured and
# made performances of training clips: 0.015 or more, or 0.02 or more in their paths)
ONE_MOTION_M, ONE_PATH_M = 0.01, 0.015


def is_one_motion(
    keypoint_sd_m: Float[np.ndarray, "M N K"], rigid_offset_sd: Float[np.ndarray, "M 6"]
) -> bool:
    """Whether the videos' deviations from their common motion are those of one performance.

    Args:
        keypoint_sd_m, rigid_offset_sd: as of `CommonMotion`.
    """
    deviation = keypoint_sd_m.mean(axis=(1, 2)).max(initial=0.0)
    path = rigid_offset_sd[:, 3:].max(initial=0.0)
    return bool(deviation <= ONE_MOTION_M and path <= ONE_PATH_M)


@dataclass(frozen=True)
class JointProblem:
    """What SMPL-BA solves, of the videos that take part, and the way back to artifacts.

    Attributes:
        participants: the artifacts behind it; scene: what stays fixed.
        start: every participant's monocular motion, in its own camera's axes.
    """

    participants: Participants
    scene: Scene
    start: MotionState
    options: MotionParams

    def synchronised(self, sync: SyncSummary) -> JointProblem:
        """The same problem with other correspondences."""
        scene, matches = self.scene, self.participants.sync(sync)
        return replace(self, scene=scene_of(scene.body, scene.observations, matches, scene.fit))

    def on_axis_of(
        self, sync: SyncSummary, motion: JointMotion
    ) -> tuple[JointProblem, JointMotion]:
        """The problem on the time axis of another reference, and a solution to begin from: the
        world's axes are that video's camera's. What all had in common had the other axis."""
        problem = self.synchronised(sync)
        cameras = motion.cameras.in_axes_of(problem.scene.reference)
        return problem, replace(motion, cameras=cameras, common=None)

    def recovered(
        self, sync: SyncSummary, before: JointMotion, progress: Progress, *, restart: bool
    ) -> JointMotion:
        """The motion with other correspondences, begun at an earlier one; with `restart` through
        all robust scales again (docs/decisions.md)."""
        return solve_jointly(
            self.synchronised(sync).scene,
            before.state,
            self.options,
            progress,
            cameras=before.cameras,
            restart=restart,
        )

    def result(self, motion: JointMotion) -> SmplBa:
        """SMPL-BA's result as an artifact: as filmed, and of all videos."""
        scene, keypoints = self.scene, self.participants.keypoints
        reference = keypoints.videos[scene.reference].id
        return self.participants.as_filmed(
            smpl_ba_of(scene.body, motion, scene.observations, keypoints, reference)
        )

    def solution(self, result: SmplBa) -> JointMotion:
        """A stored result as it was solved."""
        motions = self.participants.motions(result.videos)
        cameras = self.participants.cameras(result.cameras)
        return joint_motion_of(result, motions, cameras, self.scene.body.model.v_template)

    def filmed_joints(self, motion: JointMotion) -> list[Float[np.ndarray, "_ 24 3"]]:
        """SMPL's joints of all videos as filmed, metres, in their own cameras' axes."""
        body = self.scene.body
        xyz = body.positions(body.joints, motion.state.uncached()).cpu().numpy()
        rows = zip(xyz, self.scene.observations, strict=True)
        return self.participants.filmed_joints([x[: len(o.xy_px)] for x, o in rows])

    def scene_of(self, motion: JointMotion) -> Scene:
        """The scene with the solved intrinsics."""
        return self.scene.with_intrinsics(motion.cameras)

    def reprojection_evidence(self, motion: JointMotion) -> ReprojectionEvidence:
        """All motions in one world, to be compared with every video's detections."""
        body, cameras = self.scene.body, motion.cameras
        xyz = body.positions(body.keypoints, motion.state.uncached()).cpu().numpy()
        videos = []
        observations = self.scene_of(motion).observations
        rows = zip(observations, xyz, cameras.K, cameras.R, cameras.t, strict=True)
        for o, x, *camera in rows:
            K, R, t = (value.cpu().numpy() for value in camera)
            x = x[: len(o.xy_px)]
            world = (x - t) @ R
            weight = o.confidence / o.sigma_px[:, None] ** 2
            o, middle = from_one_place(o, x)
            xy = np.where(weight[..., None] > 0, o.xy_px, 0.0)
            videos.append(CalibratedVideo(world, xy, weight, K, R, t - middle))
        return ReprojectionEvidence(videos)


def problem_of(
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    sync: SyncSummary,
    fit: FitParams,
    motion: MotionParams,
    *,
    event: bool = False,
    device: str = "cpu",
) -> JointProblem:
    """The joint motion's problem for some videos and their correspondences.

    Args:
        event: all videos show one performance, so there is one motion for all of them.
        device: where it is solved.
    """
    motion = replace(motion, objective="single") if event else motion
    model = body_for(keypoints, device).model
    chosen = sync.alternatives
    motions = initial.model_copy(update={"videos": hypotheses.chosen_motions(initial, chosen)})
    participants = participants_of(keypoints, camera_motion, motions, sync, model)
    fit = fit_of(participants.keypoints, fit)
    body = body_for(participants.keypoints, device)  # an excluded video's layout may be another
    observations = observations_of(
        body,
        participants.keypoints,
        participants.camera_motion,
        fit,
        estimated_joints(participants.initial),
        participants.initial.path_units,
    )
    videos = participants.keypoints.videos
    ups = {}
    for video, ground in zip(initial.videos, initial.grounds, strict=False):
        side = -1.0 if video.id in participants.mirrored else 1.0
        ups[video.id] = ground.up * [side, 1.0, 1.0], ground.tilt_sd_deg
    observations = [
        replace(o, up=ups.get(video.id)) for o, video in zip(observations, videos, strict=True)
    ]
    scene = scene_of(body, observations, participants.sync(sync), fit)
    start = state_of(participants.initial.videos, body.model.v_template)
    return JointProblem(participants, scene, start, motion)


def shows_one_motion(motion: JointMotion) -> bool:
    """Whether the videos of a joint motion differ as little as those of one performance."""
    spread = motion.spread
    return spread is not None and is_one_motion(spread.keypoints_m, spread.offset_sd)


def scene_of(
    body: Body, observations: Sequence[Observation], sync: SyncSummary, fit: FitParams
) -> Scene:
    """What SMPL-BA keeps fixed, for one set of correspondences."""
    reference = sync.ids.index(sync.reference)
    maps = [m.reference_frame for m in sync.maps]
    trust = [m.confidence for m in sync.maps]
    timeline = make_timeline(maps, trust, sync.lengths[reference])
    prior = load_pose_prior(body.model.device)
    beyond = _beyond_reference(sync, observations[reference].fps)
    return Scene(body, prior, observations, timeline, trust, reference, fit, beyond)


def _beyond_reference(sync: SyncSummary, fps: float) -> list[BeyondReference]:
    """Of every video the frames that others show and the reference does not; none where the
    synchronisation says nothing of them. fps: of the reference."""
    if sync.trust is None:
        return []
    beyond = []
    last = sync.lengths[sync.ids.index(sync.reference)] - 1
    for video, matches in zip(sync.trust.videos, sync.maps, strict=True):
        if video.phase_confidence is None:
            return []
        position = fps * video.phase_s
        outside = ((position < 0) | (position > last)) & ~np.isfinite(matches.reference_frame)
        confidence = np.where(outside, video.phase_confidence, 0.0)
        beyond.append(BeyondReference(np.where(outside, position, np.nan), confidence))
    return beyond


def _single_video_sync(video: str, frames: int) -> SyncSummary:
    """Correspondences of a video with itself."""
    identity = SyncMap(
        id=video, reference_frame=np.arange(frames, dtype=float), confidence=np.ones(frames)
    )
    return SyncSummary(
        reference=video,
        ids=[video],
        lengths=[frames],
        maps=[identity],
        method="none",
        centrality=np.ones(1),
        status="alone",
    )


@dataclass(frozen=True)
class SolvedGroup:
    """Videos that were solved together: their problem and its solution."""

    problem: JointProblem
    solution: JointMotion

    @property
    def ids(self) -> list[str]:
        """The videos."""
        return [video.id for video in self.problem.participants.keypoints.videos]


def solved_groups(
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    refined: RefineSync,
    fit: FitParams,
    motion: MotionParams,
    device: str = "cpu",
) -> list[SolvedGroup]:
    """First the videos that take part, then each excluded one; device: where they are solved."""
    problem = problem_of(
        keypoints, camera_motion, initial, refined.sync, fit, motion, device=device
    )
    together = SolvedGroup(problem, problem.solution(refined.motion))
    ids = [video.id for video in keypoints.videos]
    return [
        together,
        *(
            _alone(
                ids.index(video), keypoints, camera_motion, initial, refined, fit, motion, device
            )
            for video in refined.sync.excluded
        ),
    ]


def _alone(
    index: int,
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    refined: RefineSync,
    fit: FitParams,
    motion: MotionParams,
    device: str,
) -> SolvedGroup:
    """One video as an action of its own."""
    video, together = keypoints.videos[index], refined.motion
    motions = hypotheses.chosen_motions(initial, refined.sync.alternatives)
    problem = problem_of(
        Keypoints(videos=[video]),
        CameraMotion(videos=[camera_motion.videos[index]]),
        initial.model_copy(update={"videos": [motions[index]]}),
        _single_video_sync(video.id, len(video.frames)),
        fit,
        motion,
        device=device,
    )
    result = together.model_copy(
        update={
            "videos": [together.videos[index]],
            "cameras": [together.cameras[index]],
            "common": None,
        }
    )
    return SolvedGroup(problem, problem.solution(result))
