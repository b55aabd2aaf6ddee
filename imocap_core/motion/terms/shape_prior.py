"""The shape prior: beta ~ N(0, 1). Every fitter needs one; the paper does not print it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState


@dataclass(frozen=True)
class ShapePrior:
    """``weight * |beta|^2``: beta is in standard deviations of the population."""

    weight: float

    def of(self, v: int, frames: int) -> ShapePrior:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return self.weight * state.betas.square().sum(-1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """A constant diagonal."""
        count = state.betas.shape[1]
        torch.diagonal(normal.corner, dim1=-2, dim2=-1)[:, :count] += self.weight
        normal.corner_gradient[:, :count] += self.weight * state.betas
