"""Refits of videos in which a detector took left for right for a while, as the others say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Int

from imocap_core.artifacts.schemas import AlternativeMotion, Keypoints, VideoMotion
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.fit import CoarseFits
from imocap_core.motion.monocular.hypotheses import from_starts
from imocap_core.motion.monocular.library import Library
from imocap_core.motion.monocular.starts import lifted_starts
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import PosePrior
from imocap_core.params import FitParams, InitialSmplParams
from imocap_core.problem.hypotheses import FIRST, candidates_of
from imocap_core.problem.motions import motions_of
from imocap_core.sync.hypotheses.messages import SWAPPED
from imocap_core.sync.hypotheses.swapped_sides import swapped_by_others, with_swapped_sides


def refits_of_swapped(
    body: Body,
    prior: PosePrior,
    library: Library,
    observations: Sequence[Observation],
    keypoints: Keypoints,
    motions: Sequence[VideoMotion],
    coarse: CoarseFits,
    options: InitialSmplParams,
    weights: FitParams,
    *,
    videos: Sequence[int],
) -> list[AlternativeMotion]:
    """The alternative of each video whose sides the other videos' motions swap for a while.

    Args:
        motions: of lowest cost; coarse: their fits.
        videos: those that may have alternatives.
    """
    rows = zip(motions, keypoints.videos, strict=True)
    states = swapped_by_others([candidates_of(m, [], v) for m, v in rows], SMPL_JOINTS)
    refits = []
    for v in videos:
        if not states[v].any():
            continue
        observation = with_sides(observations[v], states[v], body.keypoints.names, coarse.stride)
        starts = lifted_starts(body, library, observation, options)
        alone, least = Keypoints(videos=[keypoints.videos[v]]), coarse.best_cost(v, len(states[v]))
        fits = from_starts(
            body, prior, library, observation, starts, coarse.stride, weights,
            count=options.hypotheses,
        )  # fmt: skip
        refits += [
            AlternativeMotion(
                name=SWAPPED if fit.name == FIRST else f"{SWAPPED}, {fit.name}",
                excess_cost=fit.cost - least,
                motion=motions_of(body, fit.motion, [observations[v]], alone)[0],
                swapped=states[v],
            )
            for fit in fits
        ]
    return refits


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
