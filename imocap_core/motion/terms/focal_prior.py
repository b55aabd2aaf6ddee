"""Prior on unknown focal lengths."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState


@dataclass(frozen=True)
class FocalPrior:
    """``weight * (log f - log f_assumed)^2`` of every free focal length.

    Attributes:
        assumed: (F,) logarithm of the assumed focal length over that of the view; weight: (F,).
    """

    assumed: Float[Tensor, " F"]
    weight: Float[Tensor, " F"]

    def of(self, v: int, frames: int) -> FocalPrior:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return (self.weight * (state.log_focal - self.assumed).square()).sum(-1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """A constant diagonal."""
        first = state.focal_column(0)
        columns = slice(first, first + len(self.weight))
        torch.diagonal(normal.corner, dim1=-2, dim2=-1)[:, columns] += self.weight
        normal.corner_gradient[:, columns] += self.weight * (state.log_focal - self.assumed)
