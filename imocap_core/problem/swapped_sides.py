"""Refits of videos in which a detector took left for right for a while, as the others say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Int

from imocap_core.artifacts.schemas import AlternativeMotion, InitialSmpl
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.monocular.hypotheses import from_starts
from imocap_core.motion.monocular.starts import lifted_starts
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import PosePrior
from imocap_core.params import FitParams, InitialSmplParams
from imocap_core.problem.hypotheses import FIRST, candidates_of
from imocap_core.problem.motions import alternatives_of
from imocap_core.problem.observations import body_for, fit_of_single_views
from imocap_core.problem.single_video import SingleVideo, least_cost, library_of
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
    body, stride = body_for(single.keypoints, prior.mean.device), single.stride(options)
    weights = fit_of_single_views(single.keypoints, fit, {}, options.shape_prior)
    library = library_of(body, prior, rng, options)
    observed = single.observed(body, weights, {})
    observation = with_sides(observed[0], states, body.keypoints.names, stride)
    starts = lifted_starts(body, library, observation, options)
    fits = from_starts(
        body, prior, library, observation, starts, stride, weights, count=options.hypotheses
    )
    return alternatives_of(body, [fits], observed, single.keypoints)


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
