"""A Gaussian-mixture pose prior as a term of the objective."""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.state import POSE, MotionState
from imocap_core.rotations import log, right_jacobian


@dataclass(frozen=True)
class PosePriorTerm:
    """Twice the negative log likelihood of each frame under its best component (max-mixture).

    Max-mixture (Olson & Agarwal, 2013; used for bodies by SMPLify) keeps the term a sum of
    squares: the best component's Mahalanobis distance plus its constant.
    """

    prior: PosePrior
    weight: float

    def of(self, v: int, frames: int) -> Self:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Tensor:
        """(B,) summed over valid frames."""
        distance, _ = self.prior.best(_articulation(state))
        return self.weight * torch.where(state.valid, distance, 0.0).sum(1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Precision of the best component, pulled back by d theta / d delta = Jr^-1."""
        theta = _articulation(state)
        _, component = self.prior.best(theta)
        pull = torch.linalg.inv(right_jacobian(log(state.R_local[:, :, 1:])))
        precision = self.prior.precision[component] * self.weight
        precision = precision * state.valid[..., None, None]
        offset = theta - self.prior.mean[component]
        joints = pull.shape[2]
        blocks = precision.unflatten(-1, (joints, 3))
        right = torch.einsum("btnjx,btjxy->btnjy", blocks, pull).flatten(-2)
        both = torch.einsum("btjxm,btjxy->btjym", right.unflatten(-2, (joints, 3)), pull)
        slope = (precision @ offset[..., None])[..., 0].unflatten(-1, (joints, 3))
        normal.diagonal[..., 3:POSE, 3:POSE] += both.flatten(2, 3)
        normal.gradient[..., 3:POSE] += torch.einsum("btjxy,btjx->btjy", pull, slope).flatten(2)


def _articulation(state: MotionState) -> Tensor:
    """(B, T, 69) axis-angle of every joint but the root."""
    return log(state.R_local[:, :, 1:]).flatten(2)
