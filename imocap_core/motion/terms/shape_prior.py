"""The shape prior: beta ~ N(0, 1). Every fitter needs one; the paper does not print it.

Images tell proportions, not size: a small person near the camera looks like a tall one far away.
Errors of the keypoints would leak into the size through the proportions that go with it in the
population, so the direction in which a body's size changes has a weight of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.body import Model
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState


@dataclass(frozen=True)
class ShapePrior:
    """``beta^T precision beta``: beta is in standard deviations of the population."""

    precision: Float[Tensor, "n n"]

    @classmethod
    def of_body(cls, model: Model, weight: float, size_weight: float) -> ShapePrior:
        """``weight`` in every direction but that of size, which has ``size_weight``."""
        size = size_direction(model)
        other = torch.eye(len(size)).to(size) - torch.outer(size, size)
        return cls(weight * other + size_weight * torch.outer(size, size))

    def of(self, v: int, frames: int) -> ShapePrior:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return torch.einsum("bi,ij,bj->b", state.betas, self._precision(state), state.betas)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """A constant block."""
        precision = self._precision(state)
        count = state.betas.shape[1]
        normal.corner[:, :count, :count] += precision
        normal.corner_gradient[:, :count] += state.betas @ precision

    def _precision(self, state: MotionState) -> Float[Tensor, "n n"]:
        return self.precision.to(state.betas)


def size_direction(model: Model) -> Float[Tensor, " n"]:
    """Unit vector of shape coefficients along which the body's bones grow most, all together."""
    parents = torch.as_tensor(model.parents[1:], device=model.device)
    bones = model.joints_template[1:] - model.joints_template[parents]
    growth = model.joints_shapedirs[1:] - model.joints_shapedirs[parents]
    lengths = torch.linalg.vector_norm(bones, dim=-1, keepdim=True)
    longer = torch.einsum("jc,jcb->b", bones / lengths, growth)[: model.num_betas]
    return longer / torch.linalg.vector_norm(longer)
