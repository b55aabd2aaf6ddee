"""Covariance of each video's own motion, the common motion given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.multiview.facing import facing_agreement
from imocap_core.motion.multiview.per_video import (
    deviation_terms,
    foot_contact_term,
    targets_of,
)
from imocap_core.motion.multiview.scene import Scene, per_video_terms
from imocap_core.motion.posterior.common_posterior import CommonEvidence
from imocap_core.motion.posterior.noise import Noise
from imocap_core.motion.solver.gauss_newton import split_batch
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.solver.objective import linearise
from imocap_core.motion.solver.selected import factorise
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms import PathCoupling, PoseCoupling, Term
from imocap_core.params import MotionParams


@dataclass(frozen=True)
class PerVideoFit:
    """One video's own fit (batch of 1, no padding): its motion, all its terms, and those of them
    that couple it to the common motion."""

    state: MotionState
    terms: list[Term]
    couplings: list[Term]


@dataclass(frozen=True)
class PerVideoPosterior:
    """Covariance of one video's local increments, the common motion given.

    Attributes:
        normal: the normal matrix whose inverse this is; None where a common motion was given.
        given_shape: (T, 75, 75) covariance of each frame if the shape were known.
        response: (T, 75, 10) how the frames follow the shape.
        schur: (10, 10) this video's information about the shape (inverse covariance; videos of one
            body add up).
        gain: (T, 75, 75) how far each frame follows a persistent displacement of the common motion.
    """

    normal: NormalEquations | None
    given_shape: Float[Tensor, "T 75 75"]
    response: Float[Tensor, "T 75 10"]
    schur: Float[Tensor, "10 10"]
    gain: Float[Tensor, "T 75 75"]


def per_video_fits(
    scene: Scene,
    state: MotionState,
    common: CommonEvidence | None,
    options: MotionParams,
    noise: Noise,
) -> list[PerVideoFit]:
    """Every video's own fit, with the evidence's weights of a posterior.

    Args:
        scene: with the priors of a posterior (`Noise.scene`).
        state: every video's motion in its own camera's axes.
        common: None for videos that were fitted by themselves.
    """
    terms = [*per_video_terms(scene, state.trans), foot_contact_term(scene, state, state)]
    terms = noise.temper(terms, scene.fps)
    couplings: list[Term] = []
    if common is not None:
        targets = targets_of(scene, state, common.motion, common.cameras)
        faces = facing_agreement(scene, state, targets)
        couplings = deviation_terms(
            scene, state, common.motion, common.cameras, common.spread, options, faces
        )
    return [
        PerVideoFit(motion.state, motion.terms, motion.terms[len(terms) :])
        for motion in split_batch(terms + couplings, state)
    ]


def per_video_posterior(fit: PerVideoFit) -> PerVideoPosterior:
    """The inverse of a per-video fit's normal matrix, without damping."""
    normal = linearise(fit.terms, fit.state)
    factored = factorise(normal.diagonal[0], normal.next1[0], normal.next2[0])
    response = factored.solve(normal.border[0])
    schur = normal.corner[0] - torch.einsum("tni,tnj->ij", normal.border[0], response)
    alone = None if fit.couplings else normal
    del normal  # the largest arrays
    gain = factored.solve(torch.diag_embed(_coupling_weights(fit.couplings, fit.state)))
    return PerVideoPosterior(alone, factored.inverse_diagonal(), response, schur, gain)


def _coupling_weights(couplings: list[Term], state: MotionState) -> Tensor:
    """(T, 75) the diagonal of the couplings' normal matrix."""
    weights = state.trans.new_zeros(state.valid.shape[1], FRAME_UNKNOWNS)
    for term in couplings:
        if isinstance(term, PoseCoupling):
            weights[:, :-3] += term.weight[0].repeat_interleave(3, -1)
        else:
            weights[:, -3:] += cast(PathCoupling, term).weight[0, :, None]
    return weights
