"""The monocular fit of one video, which nothing but that video determines.

What does not matter to it (its name, where its files lie, what is noted of it) is left out first,
so that every action that has the video finds the fit again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    PathUnit,
    StartFit,
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.lifter.infer import Lifted
from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.fit import fit_monocular
from imocap_core.motion.monocular.hypotheses import alternatives
from imocap_core.motion.monocular.library import Library, make_library
from imocap_core.motion.monocular.starts import Start
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import PosePrior
from imocap_core.params import FitParams, InitialSmplParams
from imocap_core.problem.estimates import Estimate
from imocap_core.problem.ground import grounds_of
from imocap_core.problem.motions import alternatives_of, motions_of, starts_of
from imocap_core.problem.observations import (
    body_for,
    fit_of_single_views,
    observations_of,
)
from imocap_core.problem.path_units import path_units
from imocap_core.problem.starts import (
    KEYPOINTS_ALONE,
    lifted_joints,
    starts,
)

ANY = "video"  # the name that a video has while it is fitted


@dataclass(frozen=True)
class SingleVideo:
    """One video's detections and camera, under the name `ANY`.

    Attributes:
        keypoints, cameras: of this video alone; estimate: of a monocular estimator, or None.
    """

    keypoints: Keypoints
    cameras: CameraMotion
    estimate: Estimate

    @property
    def detected(self) -> Float[np.ndarray, "T 24 3"] | None:
        """The detector's own 3D joints in the axes of the first frame's camera, where no estimator
        gives a motion."""
        (video,), (camera,) = self.keypoints.videos, self.cameras.videos
        if video.joints_m is None or self.estimate is not None:
            return None
        return np.einsum("tij,tkj->tki", camera.R_first_from_frame, video.joints_m)

    @classmethod
    def of(
        cls, video: VideoKeypoints, camera: VideoCameraMotion, estimate: Estimate
    ) -> SingleVideo:
        """A video of an action, without what its fit does not depend on."""
        unnamed = {"id": ANY, "video": None, "initial": None, "note": "", "performer": None}
        return cls(
            Keypoints(videos=[video.model_copy(update=unnamed)]),
            CameraMotion(videos=[camera.model_copy(update={"id": ANY, "note": ""})]),
            estimate,
        )

    @property
    def frames(self) -> int:
        """Used frames."""
        return len(self.keypoints.videos[0].frames)

    def stride(self, options: InitialSmplParams) -> int:
        """The first fits are on every so many frames."""
        return max(1, round(options.stride_s * self.keypoints.videos[0].fps))


@dataclass(frozen=True)
class SingleProblem:
    """What all fits of one video share.

    Attributes:
        lifted: the lifter's joints where there is no estimate, or None: a start, no evidence.
        weights: of the objective; options: of the starts.
    """

    single: SingleVideo
    body: Body
    library: Library
    lifted: Lifted | None
    weights: FitParams
    options: InitialSmplParams

    @classmethod
    def of(
        cls,
        single: SingleVideo,
        prior: PosePrior,
        rng: np.random.Generator,
        fit: FitParams,
        options: InitialSmplParams,
    ) -> SingleProblem:
        """The library of poses, the lifter's joints, and the weights of a single view."""
        device = prior.mean.device
        body = body_for(single.keypoints, device)
        library = make_library(
            body, prior, rng, poses=options.library_poses, directions=options.library_directions
        )
        lifted = None
        if options.lifter == "auto" and single.estimate is None:
            (video,), (camera,) = single.keypoints.videos, single.cameras.videos
            lifted = lifted_joints(video, camera, device)
        joints_given = isinstance(single.estimate, np.ndarray)
        weights = fit_of_single_views(single.keypoints, fit, joints_given, options.shape_prior)
        return cls(single, body, library, lifted, weights, options)

    @property
    def source(self) -> str:
        """Origin of the motions."""
        given = self.single.estimate is not None
        return self.single.keypoints.videos[0].initial_format or "" if given else KEYPOINTS_ALONE

    def observed(self, units: Sequence[PathUnit] = ()) -> list[Observation]:
        """What the fits work on, with the 3D joints of an estimate, if any, as evidence."""
        estimate = self.single.estimate
        joints = {ANY: estimate} if isinstance(estimate, np.ndarray) else {}
        keypoints, cameras = self.single.keypoints, self.single.cameras
        return observations_of(self.body, keypoints, cameras, self.weights, joints, units)

    def starts(self, observation: Observation) -> list[Start]:
        """Starting points of the fit to an observation."""
        given = self.single.estimate, self.lifted, self.single.detected
        return starts(self.body, self.library, observation, *given, self.options)


def fit_single_video(
    single: SingleVideo,
    prior: PosePrior,
    rng: np.random.Generator,
    fit: FitParams,
    options: InitialSmplParams,
    *,
    alone: bool,
    progress: Callable[[str], None] = lambda _: None,
) -> InitialSmpl:
    """The motion of lowest cost of one video, its alternatives, and the ground under it.

    alone: no other video can choose among alternatives, so there are none, or tell how far the
    body leans, so it balances.
    """
    keypoints, cameras = single.keypoints, single.cameras
    problem = SingleProblem.of(single, prior, rng, fit, options)
    body, weights, observations = problem.body, problem.weights, problem.observed()
    units = path_units(
        body, prior, keypoints, cameras, observations, lambda _, o: problem.starts(o), weights,
        options.stride_s,
    )  # fmt: skip
    if units:
        observations = problem.observed(units)
    solved = fit_monocular(
        body, prior, observations, [problem.starts(observations[0])], weights,
        stride=single.stride(options), max_steps=options.max_steps, balance=alone,
        progress=progress,
    )  # fmt: skip
    motions = motions_of(body, solved.state, observations, keypoints)
    progress("other motions that may explain the video")
    count = 0 if alone or single.estimate is not None else options.hypotheses - 1
    others = alternatives(
        body, prior, problem.library, observations, solved.coarse, weights,
        videos=[0] if count else [], count=count,
    )  # fmt: skip
    return InitialSmpl(
        model=body.model.name,
        model_digest=body.model.digest,
        videos=motions,
        source={ANY: problem.source},
        starts=starts_of([ANY], solved.costs),
        alternatives=alternatives_of(body, others, observations, keypoints),
        grounds=grounds_of(motions, keypoints, cameras, fit),
        path_units=units,
    )


def joined(fits: Sequence[InitialSmpl], ids: Sequence[str]) -> InitialSmpl:
    """The fits of an action's videos as one result; ids: their names there."""
    pairs = list(zip(fits, ids, strict=True))
    return InitialSmpl(
        model=fits[0].model,
        model_digest=fits[0].model_digest,
        videos=[fit.videos[0].model_copy(update={"id": i}) for fit, i in pairs],
        source={i: fit.source[ANY] for fit, i in pairs},
        starts=[start.model_copy(update={"video": i}) for fit, i in pairs for start in fit.starts],
        alternatives=[
            other.model_copy(update={"motion": other.motion.model_copy(update={"id": i})})
            for fit, i in pairs
            for other in fit.alternatives
        ],
        grounds=[ground for fit in fits for ground in fit.grounds],
        path_units=[
            unit.model_copy(update={"id": i}) for fit, i in pairs for unit in fit.path_units
        ],
    )


def least_cost(starts: Sequence[StartFit], frames: int, stride: int) -> float:
    """The lowest objective a frame of the first fits of a video of so many frames."""
    return min(start.cost for start in starts) / len(range(0, frames, stride))
