"""The coupling between videos, Eq. 8's last two terms on the manifold."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import POSE, MotionState
from imocap_core.rotations import log


@dataclass(frozen=True)
class PoseCoupling:
    """``lambda_r1 |theta - Z|^2`` with the difference taken on the rotation manifold.

    Attributes:
        target: (B, T, 24, 3, 3) the low-rank poses Z, in each motion's own axes.
        weight: (B, T, 24) per joint, 1/rad^2; 0 leaves a joint free.
    """

    target: Float[Tensor, "B T 24 3 3"]
    weight: Float[Tensor, "B T 24"]

    def _residual(self, state: MotionState) -> Tensor:
        return state.cached((self,), lambda: log(self.target.mT @ state.R_local))

    def of(self, v: int, frames: int) -> PoseCoupling:
        """One motion's target."""
        return replace(
            self, target=self.target[v : v + 1, :frames], weight=self.weight[v : v + 1, :frames]
        )

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return (self.weight * self._residual(state).square().sum(-1)).sum((1, 2))

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """The gradient is exactly the residual (the rotation keeps its own axis)."""
        weight = self.weight[..., None].expand(*self.weight.shape, 3)
        normal.gradient[..., :POSE] += (weight * self._residual(state)).flatten(2)
        torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)[..., :POSE] += weight.flatten(2)


@dataclass(frozen=True)
class PathCoupling:
    """``lambda_r2 |gamma - Y|^2``.

    Attributes:
        target: (B, T, 3) the low-rank root paths Y in each motion's own axes, metres.
        weight: (B, T) 1/m^2.
    """

    target: Float[Tensor, "B T 3"]
    weight: Float[Tensor, "B T"]

    def of(self, v: int, frames: int) -> PathCoupling:
        """One motion's target."""
        return replace(
            self, target=self.target[v : v + 1, :frames], weight=self.weight[v : v + 1, :frames]
        )

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return (self.weight * (state.trans - self.target).square().sum(-1)).sum(1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Linear."""
        normal.gradient[..., POSE:] += self.weight[..., None] * (state.trans - self.target)
        torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)[..., POSE:] += self.weight[..., None]
