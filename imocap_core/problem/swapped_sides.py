"""Refits of videos in which a detector took left for right for a while, as the others say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Int

from imocap_core.artifacts.schemas import AlternativeMotion, CameraMotion, InitialSmpl, Keypoints
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.monocular.hypotheses import from_starts
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import PosePrior
from imocap_core.params import FitParams, InitialSmplParams
from imocap_core.problem.hypotheses import FIRST, candidates_of
from imocap_core.problem.motions import alternatives_of
from imocap_core.problem.single_video import SingleProblem, SingleVideo, least_cost
from imocap_core.problem.starts import KEYPOINTS_ALONE
from imocap_core.sync.hypotheses.messages import SWAPPED
from imocap_core.sync.hypotheses.swapped_sides import swapped_by_others, with_swapped_sides


def refits_of_swapped(
    singles: Sequence[SingleVideo],
    result: InitialSmpl,
    prior: PosePrior,
    rng: Callable[[], np.random.Generator],
    fit: FitParams,
    options: InitialSmplParams,
) -> list[AlternativeMotion]:
    """The alternative of each video whose sides the other videos' motions swap for a while.

    Args:
        result: the fits of all videos; those that begin at an estimate have no alternatives.
    """
    videos = [single.keypoints.videos[0] for single in singles]
    rows = zip(result.videos, videos, strict=True)
    states = swapped_by_others([candidates_of(m, [], v) for m, v in rows], SMPL_JOINTS)
    refits = []
    for v, motion in enumerate(result.videos):
        if result.source[motion.id] != KEYPOINTS_ALONE or not states[v].any():
            continue
        starts = [start for start in result.starts if start.video == motion.id]
        least = least_cost(starts, singles[v].frames, singles[v].stride(options))
        fits = fits_with_sides(singles[v], states[v], prior, rng(), fit, options)
        refits += [
            AlternativeMotion(
                name=SWAPPED if refit.name == FIRST else f"{SWAPPED}, {refit.name}",
                excess_cost=refit.excess_cost - least,
                motion=refit.motion.model_copy(update={"id": motion.id}),
                swapped=states[v],
            )
            for refit in fits
        ]
    return refits


def fits_with_sides(
    single: SingleVideo,
    states: Int[np.ndarray, " T"],
    prior: PosePrior,
    rng: np.random.Generator,
    fit: FitParams,
    options: InitialSmplParams,
) -> list[AlternativeMotion]:
    """The distinct fits of one video whose detections have swapped sides, with their own costs.

    Args:
        states: as of `swapped_by_others`.
    """
    problem = SingleProblem.of(swapped_video(single, states), prior, rng, fit, options)
    body, stride = problem.body, single.stride(options)
    observed = replace(problem, single=single).observed()
    observation = with_sides(observed[0], states, body.keypoints.names, stride)
    fits = from_starts(
        body, prior, problem.library, observation, problem.starts(observation), stride,
        problem.weights, count=options.hypotheses,
    )  # fmt: skip
    return alternatives_of(body, [fits], observed, single.keypoints)


def swapped_video(single: SingleVideo, states: Int[np.ndarray, " T"]) -> SingleVideo:
    """The video as it is when the detector's sides are swapped back; states as above."""
    (video,), (camera,) = single.keypoints.videos, single.cameras.videos
    names = layout_names(video.layout)
    confidence, xy_px = (
        with_swapped_sides(x, states, names) for x in (video.confidence, camera.xy_first_px)
    )
    return replace(
        single,
        keypoints=Keypoints(videos=[video.model_copy(update={"confidence": confidence})]),
        cameras=CameraMotion(videos=[camera.model_copy(update={"xy_first_px": xy_px})]),
    )


def with_sides(
    observation: Observation, states: Int[np.ndarray, " T"], names: Sequence[str], reach: int
) -> Observation:
    """The observation with its sides swapped, without the frames within `reach` of where that
    begins or ends: the estimate is no finer.

    Args:
        states: as of `swapped_by_others`; names: of the keypoints.
    """
    changes = np.flatnonzero(np.diff(states))
    near = np.abs(np.arange(len(states))[:, None] - changes - 0.5).min(axis=1, initial=np.inf)
    confidence = with_swapped_sides(observation.confidence, states, names)
    return replace(
        observation,
        xy_px=with_swapped_sides(observation.xy_px, states, names),
        confidence=np.where(near[:, None] < reach, 0.0, confidence),
    )
