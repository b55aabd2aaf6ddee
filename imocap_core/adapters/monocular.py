"""The monocular fit of one video, which nothing but that video determines.

The units of moving cameras' paths in metres, before the monocular fits. What does not matter to it
(its name, where its files lie, what is noted of it) is left out first, so that every action that
has the video finds the fit again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.adapters.estimates import Estimate
from imocap_core.adapters.ground import fall_cost, grounds_of
from imocap_core.adapters.observations import (
    alternatives_of,
    fit_of_single_views,
    layouts_of,
    motions_of,
    observations_of,
    starts_of,
)
from imocap_core.artifacts.schemas import (
    AlternativeMotion,
    CameraMotion,
    InitialSmpl,
    Keypoints,
    PathUnit,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import load_free_body
from imocap_core.lifter.infer import Lifted, lift
from imocap_core.lifter.lifter_network import can_lift, load_lifter, to_common
from imocap_core.motion.monocular.fit import (
    estimate_path_unit,
    fit_monocular,
    guessed_unit,
    predicted_limbs,
    with_unit,
)
from imocap_core.motion.monocular.hypotheses import alternatives
from imocap_core.motion.monocular.starts import (
    Library,
    Start,
    fit_rotations_to_joints,
    lifted_starts,
    make_library,
    start_at_joints,
)
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.state import Body
from imocap_core.params import FitParams, InitialSmplParams

KEYPOINTS_ALONE = "monocular"  # origin of a fit without an estimate


def starts(
    body: Body,
    library: Library,
    observation: Observation,
    estimate: Estimate,
    lifted: Lifted | None,
    detected: Float[np.ndarray, "T 24 3"] | None,
    options: InitialSmplParams,
) -> list[Start]:
    """Starting points of one video: its estimate; or the lifter's and the detector's joints, then
    the library's poses."""
    if isinstance(estimate, Start):
        R_local, trans = (x.to(library.R_view) for x in (estimate.R_local, estimate.trans))
        return [Start(R_local, trans, estimate.cost)]
    if isinstance(estimate, torch.Tensor):
        return [start_at_joints(body, estimate.to(library.R_view), observation)]
    if estimate is not None:
        R_local = fit_rotations_to_joints(body, library, estimate)
        return [start_at_joints(body, R_local, observation)]
    joints = [] if detected is None else [detected]
    if lifted is not None:
        unseen = ~lifted.visible[:, None, None]
        joints += [np.where(unseen, np.nan, x) for x in (lifted.joints, lifted.alternative)]
    rotations = [fit_rotations_to_joints(body, library, x) for x in joints]
    of_joints = [start_at_joints(body, R_local, observation) for R_local in rotations]
    return [*of_joints, *lifted_starts(body, library, observation, options)]


def lifted_joints(
    video: VideoKeypoints, camera: VideoCameraMotion, device: torch.device | str = "cpu"
) -> Lifted | None:
    """3D joints of a video's keypoints, in the axes of its first frame's camera.

    None when the layout has too few of the lifter's points, or no frame shows any.
    """
    if not can_lift(video.layout):
        return None
    present = np.isfinite(camera.xy_first_px).all(-1)
    weight = np.where(present, video.confidence, 0.0)
    focal, centre = camera.K[[0, 1], [0, 1]], camera.K[:2, 2]
    points, confidence = to_common((camera.xy_first_px - centre) / focal, weight, video.layout)
    if not (confidence > 0).any():
        return None
    return lift(load_lifter(device), points, confidence, video.fps)


def path_units(
    body: Body,
    prior: PosePrior,
    keypoints: Keypoints,
    cameras: CameraMotion,
    observations: Sequence[Observation],
    starts_of: Callable[[int, Observation], list[Start]],
    weights: FitParams,
    stride_s: float,
) -> list[PathUnit]:
    """The unit of every camera whose path is known.

    Args:
        observations: of all videos, without paths; starts_of: starts of a video (by its index)
            with an observation that has its path.
    """
    units = []
    for v, (video, camera) in enumerate(zip(keypoints.videos, cameras.videos, strict=True)):
        if not len(camera.path):
            continue
        unitless = replace(observations[v], centre_m=camera.path, place_sd_m=None)
        guess = guessed_unit(unitless)
        starts = starts_of(v, with_unit(unitless, guess))
        stride = max(1, round(stride_s * video.fps))
        unit = estimate_path_unit(body, prior, unitless, guess, starts, weights, stride)
        units.append(PathUnit(id=video.id, unit_m=unit.unit_m, relative_sd=unit.relative_sd))
    return units


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


PoseLibraries = Callable[[tuple[str, ...]], tuple[Body, Library]]


def pose_libraries(
    prior: PosePrior, rng: Callable[[], np.random.Generator], options: InitialSmplParams
) -> PoseLibraries:
    """The body with the keypoints of some layouts and its library of poses, made once for all
    videos that have these. rng: returns a fresh generator."""

    @cache
    def of_layouts(layouts: tuple[str, ...]) -> tuple[Body, Library]:
        body = Body.of(load_free_body(prior.mean.device), *layouts)
        counts = {"poses": options.library_poses, "directions": options.library_directions}
        return body, make_library(body, prior, rng(), **counts)

    return of_layouts


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
        libraries: PoseLibraries,
        fit: FitParams,
        options: InitialSmplParams,
    ) -> SingleProblem:
        """The library of poses, the lifter's joints, and the weights of a single view."""
        body, library = libraries(tuple(layouts_of(single.keypoints)))
        lifted = None
        if options.lifter == "auto" and single.estimate is None:
            (video,), (camera,) = single.keypoints.videos, single.cameras.videos
            lifted = lifted_joints(video, camera, library.R_view.device)
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
    libraries: PoseLibraries,
    fit: FitParams,
    options: InitialSmplParams,
    *,
    alone: bool,
    progress: Callable[[str], None] = lambda _: None,
) -> InitialSmpl:
    """The likeliest motion of one video, its alternatives, and the ground under it.

    alone: no other video can choose among alternatives, so there are none.
    """
    keypoints, cameras = single.keypoints, single.cameras
    problem = SingleProblem.of(single, libraries, fit, options)
    body, weights, observations = problem.body, problem.weights, problem.observed()
    units = path_units(
        body, prior, keypoints, cameras, observations, lambda _, o: problem.starts(o), weights,
        options.stride_s,
    )  # fmt: skip
    if units:
        observations = problem.observed(units)
    solved = fit_monocular(
        body, prior, observations, [problem.starts(observations[0])], weights,
        stride=single.stride(options), max_steps=options.max_steps, progress=progress,
    )  # fmt: skip
    motions = motions_of(body, solved.state, observations, keypoints)
    (limbs,) = predicted_limbs(body, prior, observations, solved.state, weights)
    progress("other motions that may explain the video")
    count = 0 if single.estimate is not None else options.hypotheses - 1
    others = alternatives(
        body, prior, problem.library, observations, solved.coarse, weights,
        videos=[0] if count else [], count=count,
    )  # fmt: skip
    rest = alternatives_of(body, others, observations, keypoints)
    every = [motions[0], *(other.motion for other in rest)]
    falls = [fall_cost(m, keypoints.videos[0], cameras.videos[0], fit) for m in every]
    first, rest = likeliest_first(motions[0], rest, falls)
    return InitialSmpl(
        model=body.model.name,
        model_digest=body.model.digest,
        videos=[first],
        source={ANY: problem.source},
        starts=starts_of([ANY], solved.costs),
        alternatives=[] if alone else rest,
        grounds=grounds_of([first], keypoints, cameras, fit),
        path_units=units,
        limb_errors={ANY: limbs.median},
    )


PER_FALL = 2.0  # objective a frame that counts as much as twice a nat of evidence from gravity


def likeliest_first(
    first: VideoMotion, others: Sequence[AlternativeMotion], falls: Sequence[float]
) -> tuple[VideoMotion, list[AlternativeMotion]]:
    """The motion of lowest cost, and the others; that which it replaces takes its name.

    A view hardly shows whether a body leans along the line of sight; one that does would fall.

    Args:
        falls: of the first and the others, `fall_cost`.
    """
    motions = [first, *(a.motion for a in others)]
    cost = np.array([0.0, *(a.excess_cost for a in others)]) + PER_FALL * np.array(falls)
    best = int(cost.argmin())
    motions[best], least = first, cost[best]
    cost[best] = cost[0]
    rest = zip(others, motions[1:], (cost[1:] - least).tolist(), strict=True)
    likeliest = first if best == 0 else others[best - 1].motion
    return likeliest, [a.model_copy(update={"motion": m, "excess_cost": x}) for a, m, x in rest]


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
        limb_errors={i: error for fit, i in pairs for error in fit.limb_errors.values()},
    )
