"""A Gaussian-mixture pose prior as a term of the objective."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.prior import PosePrior
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import POSE, MotionState
from imocap_core.rotations import inverse_right_jacobian

CHUNK = 32  # frames at once, so that their matrices fit a processor's cache


@dataclass(frozen=True)
class PosePriorTerm:
    """Twice the negative log likelihood of each frame under its best component (max-mixture).

    Max-mixture (Olson & Agarwal, 2013; used for bodies by SMPLify) keeps the term a sum of
    squares: the best component's Mahalanobis distance plus its constant.
    """

    prior: PosePrior
    weight: float

    def of(self, v: int, frames: int) -> PosePriorTerm:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion, summed over valid frames."""
        distance, _ = self._best(state)
        return self.weight * torch.where(state.valid, distance, 0.0).sum(1)

    def _best(self, state: MotionState) -> tuple[Tensor, Tensor]:
        return state.cached((self.prior,), lambda: self.prior.best(_articulation(state)))

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Precision of the best component, pulled back by d theta / d delta = Jr^-1."""
        _, component = self._best(state)
        pull = inverse_right_jacobian(state.axis_angle[:, :, 1:])
        pull = pull * state.valid[..., None, None, None]
        offset = _articulation(state) - self.prior.mean[component]
        for first in range(0, pull.shape[1], CHUNK):
            chunk = slice(first, first + CHUNK)
            precision, joints = self.prior.precision[component[:, chunk]], pull[:, chunk]
            slope = (precision @ offset[:, chunk, :, None]).unflatten(2, (-1, 3))
            square = _by_joint(joints, _by_joint(joints, precision).mT)
            normal.diagonal[:, chunk, 3:POSE, 3:POSE].add_(square, alpha=self.weight)
            pulled = (joints.mT @ slope).flatten(2)
            normal.gradient[:, chunk, 3:POSE].add_(pulled, alpha=self.weight)


def _by_joint(pull: Tensor, columns: Tensor) -> Tensor:
    """``pull^T`` (B, T, J, 3, 3), block by block, times columns (B, T, 3J, n)."""
    return (pull.mT @ columns.unflatten(2, (-1, 3))).flatten(2, 3)


def _articulation(state: MotionState) -> Tensor:
    """(B, T, 69) axis-angle of every joint but the root."""
    return state.axis_angle[:, :, 1:].flatten(2)
