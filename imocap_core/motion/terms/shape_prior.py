"""The shape prior every fitter needs and the paper does not print: beta ~ N(0, 1)."""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState


@dataclass(frozen=True)
class ShapePrior:
    """``weight * |beta|^2``: beta is in standard deviations of the population."""

    weight: float

    def of(self, v: int, frames: int) -> Self:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Tensor:
        """(B,)."""
        return self.weight * state.betas.square().sum(-1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """A constant diagonal."""
        count = state.betas.shape[1]
        torch.diagonal(normal.corner, dim1=-2, dim2=-1)[:, :count] += self.weight
        normal.corner_gradient[:, :count] += self.weight * state.betas
