"""Videos that were solved together: those of the action, and each excluded video by itself."""

from __future__ import annotations

from dataclasses import dataclass

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, RefineSync
from imocap_core.motion.multiview.scene import JointMotion
from imocap_core.params import FitParams, MotionParams
from imocap_core.problem.hypotheses import chosen_motions
from imocap_core.problem.joint import JointProblem, problem_of, single_video_sync


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
    motions = chosen_motions(initial, refined.sync.alternatives)
    problem = problem_of(
        Keypoints(videos=[video]),
        CameraMotion(videos=[camera_motion.videos[index]]),
        initial.model_copy(update={"videos": [motions[index]]}),
        single_video_sync(video.id, len(video.frames)),
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
