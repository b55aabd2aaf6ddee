"""How well each video's own motion is determined, given the common one."""

from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor

from imocap_core.motion.multiview.per_video import (
    deviation_terms,
    facing_alike,
    held_feet,
    targets_of,
)
from imocap_core.motion.multiview.scene import Scene, own_terms
from imocap_core.motion.posterior.common_posterior import Common
from imocap_core.motion.posterior.noise import Noise
from imocap_core.motion.solver.gauss_newton import take_apart
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.solver.objective import linearise
from imocap_core.motion.solver.selected import factorise
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms import PathCoupling, PoseCoupling, Term
from imocap_core.params import MotionParams


@dataclass(frozen=True)
class OwnFit:
    """One video's own fit (batch of 1, no padding): its motion, all its terms, and those of them
    that draw it to the common motion."""

    state: MotionState
    terms: list[Term]
    drawn: list[Term]


@dataclass(frozen=True)
class OwnPosterior:
    """Covariance of one video's local increments, the common motion given.

    Attributes:
        normal: the normal matrix that all this is the inverse of.
        given_shape: (T, 75, 75) covariance of each frame if the shape were known.
        response: (T, 75, 10) how the frames follow the shape; schur: (10, 10) what this video
            tells of the shape (inverse covariance; videos of one body add up).
        gain: (T, 75, 75) what a lasting displacement of the common motion does to each frame.
    """

    normal: NormalEquations
    given_shape: Tensor
    response: Tensor
    schur: Tensor
    gain: Tensor


def own_fits(
    scene: Scene,
    state: MotionState,
    common: Common | None,
    options: MotionParams,
    noise: Noise,
) -> list[OwnFit]:
    """Every video's own fit, as a posterior counts its evidence.

    Args:
        scene: with the priors of a posterior (`Noise.scene`).
        state: every video's motion in its own camera's axes.
        common: None for videos that were fitted by themselves.
    """
    terms = [*own_terms(scene, state.trans), held_feet(scene, state, state)]
    terms = noise.temper(terms, scene.fps)
    drawn: list[Term] = []
    if common is not None:
        targets = targets_of(scene, state, common.motion, common.cameras)
        faces = facing_alike(state, targets)
        drawn = deviation_terms(
            scene, state, common.motion, common.cameras, common.spread, options, faces
        )
    return [
        OwnFit(motion.state, motion.terms, motion.terms[len(terms) :])
        for motion in take_apart(terms + drawn, state)
    ]


def own_posterior(fit: OwnFit) -> OwnPosterior:
    """The inverse of an own fit's normal matrix, without damping."""
    normal = linearise(fit.terms, fit.state)
    factored = factorise(normal.diagonal[0], normal.next1[0], normal.next2[0])
    response = factored.solve(normal.border[0])
    schur = normal.corner[0] - torch.einsum("tni,tnj->ij", normal.border[0], response)
    gain = factored.solve(torch.diag_embed(_pull(fit.drawn, fit.state)))
    return OwnPosterior(normal, factored.inverse_diagonal(), response, schur, gain)


def _pull(drawn: list[Term], state: MotionState) -> Tensor:
    """(T, 75) the diagonal of the coupling's normal matrix."""
    pull = state.trans.new_zeros(state.valid.shape[1], FRAME_UNKNOWNS)
    for term in drawn:
        if isinstance(term, PoseCoupling):
            pull[:, :-3] += term.weight[0].repeat_interleave(3, -1)
        else:
            pull[:, -3:] += cast(PathCoupling, term).weight[0, :, None]
    return pull
