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
from imocap_core.problem.observations import body_for, fit_of_single_views, observations_of
from imocap_core.problem.path_units import path_units
from imocap_core.problem.starts import (
    KEYPOINTS_ALONE,
    initial_evidence,
    lifted_where_no_estimate,
    source_of,
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

    def observed(
        self,
        body: Body,
        weights: FitParams,
        evidence: dict[str, Float[np.ndarray, "T 24 3"]],
        units: Sequence[PathUnit] = (),
    ) -> list[Observation]:
        """What a fit works on; evidence: 3D joints, if any."""
        return observations_of(body, self.keypoints, self.cameras, weights, evidence, units)


def library_of(
    body: Body, prior: PosePrior, rng: np.random.Generator, options: InitialSmplParams
) -> Library:
    """The library of poses that starts are looked up in."""
    poses, directions = options.library_poses, options.library_directions
    return make_library(body, prior, rng, poses=poses, directions=directions)


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
    body, estimates = body_for(keypoints, prior.mean.device), {ANY: single.estimate}
    library = library_of(body, prior, rng, options)
    automatic = options.lifter == "auto"
    lifted = (
        lifted_where_no_estimate(keypoints, cameras, estimates, prior.mean.device)
        if automatic
        else {}
    )
    evidence = initial_evidence(estimates, lifted)
    weights = fit_of_single_views(keypoints, fit, evidence, options.shape_prior)
    observations = single.observed(body, weights, evidence)

    def starts_with(_: int, observation: Observation) -> list[Start]:
        return starts(body, library, observation, single.estimate, lifted.get(ANY), options)

    units = path_units(
        body, prior, keypoints, cameras, observations, starts_with, weights, options.stride_s
    )
    if units:
        observations = single.observed(body, weights, evidence, units)
    solved = fit_monocular(
        body, prior, observations, [starts_with(0, observations[0])], weights,
        stride=single.stride(options), max_steps=options.max_steps, balance=alone,
        progress=progress,
    )  # fmt: skip
    motions = motions_of(body, solved.state, observations, keypoints)
    source = source_of(keypoints.videos[0], estimates, lifted)
    progress("other motions that may explain the video")
    count = 0 if alone or source != KEYPOINTS_ALONE else options.hypotheses - 1
    others = alternatives(
        body, prior, library, observations, solved.coarse, weights,
        videos=[0] if count else [], count=count,
    )  # fmt: skip
    return InitialSmpl(
        model=body.model.name,
        model_digest=body.model.digest,
        videos=motions,
        source={ANY: source},
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
