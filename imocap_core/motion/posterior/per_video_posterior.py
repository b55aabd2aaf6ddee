"""Covariance of each video's own motion, the common motion given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

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
from imocap_core.motion.solver.objective import linearise
from imocap_core.motion.solver.selected import selected_inverse
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Term
from imocap_core.params import MotionParams

T = TypeVar("T")


@dataclass(frozen=True)
class PerVideoFit:
    """One video's own fit (batch of 1, no padding): its motion, all its terms, and those of them
    that couple it to the common motion."""

    state: MotionState
    terms: list[Term]
    couplings: list[Term]


@dataclass(frozen=True)
class PosteriorPiece:
    """Covariance of one video's local increments in P of its frames, the common motion given.

    Attributes:
        frames: which.
        given_shape: (P, 75, 75) covariance of each frame if the shape were known.
        response: (P, 75, 10) how the frames follow the shape.
        gain: (P, 75, 75) how far each frame follows a persistent displacement of the common motion.
    """

    frames: slice
    given_shape: Float[Tensor, "P 75 75"]
    response: Float[Tensor, "P 75 10"]
    gain: Float[Tensor, "P 75 75"]


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


def per_video_posterior(
    fit: PerVideoFit, use: Callable[[PosteriorPiece], T]
) -> tuple[list[T], Float[Tensor, "10 10"]]:
    """The inverse of a per-video fit's normal matrix, without damping, piece by piece.

    Args:
        use: what is made of a piece, which is too large to be kept.

    Returns:
        What was made of the pieces, and the video's information about the shape (inverse
        covariance; videos of one body add up).
    """
    pull = linearise(fit.couplings, fit.state).diagonal[0]  # (T, 75, 75) of the common motion
    normal = linearise(fit.terms, fit.state)
    fit.state.forget()
    border = normal.border[0]
    globals_, schur, results = border.shape[-1], normal.corner[0].clone(), list[T]()

    def right(t: int) -> Tensor:
        return torch.cat([border[t], pull[t]], 1)

    for piece in selected_inverse(normal.diagonal[0], normal.next1[0], normal.next2[0], right):
        response, gain = piece.solution[..., :globals_], piece.solution[..., globals_:]
        schur -= torch.einsum("tni,tnj->ij", border[piece.frames], response)
        results.append(use(PosteriorPiece(piece.frames, piece.diagonal, response, gain)))
    return results[::-1], schur
