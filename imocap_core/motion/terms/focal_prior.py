"""What is known of focal lengths before anything is seen."""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState


@dataclass(frozen=True)
class FocalPrior:
    """``weight * (log f - log f_assumed)^2`` of every free focal length.

    Attributes:
        assumed: (F,) logarithm of the assumed focal length over that of the view; weight: (F,).
    """

    assumed: Tensor
    weight: Tensor

    def of(self, v: int, frames: int) -> Self:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Tensor:
        """(B,)."""
        return (self.weight * (state.log_focal - self.assumed).square()).sum(-1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """A constant diagonal."""
        first = state.focal_column(0)
        torch.diagonal(normal.corner, dim1=-2, dim2=-1)[:, first:] += self.weight
        normal.corner_gradient[:, first:] += self.weight * (state.log_focal - self.assumed)
