"""How well each video's own motion is determined, given the common one."""

from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor

from imocap_core.motion.common_posterior import Common
from imocap_core.motion.noise import Noise
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.own import deviation_terms, facing_alike, targets_of
from imocap_core.motion.scene import JointOptions, Scene, own_terms
from imocap_core.motion.selected import factorise
from imocap_core.motion.solver import linearise, take_apart
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms import PathCoupling, PoseCoupling, Term


@dataclass(frozen=True)
class OwnPosterior:
    """Covariance of one video's local increments and of the body's shape, the common motion given.

    Attributes:
        normal: the normal matrix that all this is the inverse of.
        given_shape: (T, 75, 75) covariance of each frame if the shape were known.
        response: (T, 75, 10) how the frames follow the shape; shape: (10, 10) its covariance.
        gain: (T, 75, 75) what a lasting displacement of the common motion does to each frame.
    """

    normal: NormalEquations
    given_shape: Tensor
    response: Tensor
    shape: Tensor
    gain: Tensor


def own_posteriors(
    scene: Scene,
    state: MotionState,
    common: Common | None,
    options: JointOptions,
    noise: Noise,
) -> list[OwnPosterior]:
    """One posterior a video from the normal matrices of the own fits; all share one body.

    Args:
        scene: with the priors of a posterior (`Noise.scene`).
        state: every video's motion in its own camera's axes.
        common: None for videos that were fitted by themselves.
    """
    terms = noise.temper(own_terms(scene, state.trans), scene.fps)
    drawn: list[Term] = []
    if common is not None:
        targets = targets_of(scene, state, common.motion, common.cameras)
        faces = facing_alike(state, targets)
        drawn = deviation_terms(
            scene, state, common.motion, common.cameras, common.spread, options, faces
        )
    parts, schurs = [], []
    motions = take_apart(terms + drawn, state)
    for motion in motions:
        normal = linearise(motion.terms, motion.state)
        factored = factorise(normal.diagonal[0], normal.next1[0], normal.next2[0])
        response = factored.solve(normal.border[0])
        schurs.append(normal.corner[0] - torch.einsum("tni,tnj->ij", normal.border[0], response))
        pull = torch.diag_embed(_pull(motion.terms[len(terms) :], motion.state))
        parts.append((normal, factored.inverse_diagonal(), response, factored.solve(pull)))
    shared = torch.linalg.inv(torch.stack(schurs).sum(0))
    return [OwnPosterior(n, given, response, shared, gain) for n, given, response, gain in parts]


def _pull(drawn: list[Term], state: MotionState) -> Tensor:
    """(T, 75) the diagonal of the coupling's normal matrix."""
    pull = state.trans.new_zeros(state.valid.shape[1], FRAME_UNKNOWNS)
    for term in drawn:
        if isinstance(term, PoseCoupling):
            pull[:, :-3] += term.weight[0].repeat_interleave(3, -1)
        else:
            pull[:, -3:] += cast(PathCoupling, term).weight[0, :, None]
    return pull
