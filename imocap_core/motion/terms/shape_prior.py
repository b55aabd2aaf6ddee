"""The shape prior: beta ~ N(0, 1). Every fitter needs one; the paper does not print it.

Images tell proportions, not size: a small person near the camera looks like a tall one far away.
Nor do they tell a torso's form: bodies with the same limbs, hips, shoulders and height of the trunk
differ in where the spine runs. Errors of keypoints and poses would leak into both, so size and the
directions of shape that no keypoint tells have weights of their own (docs/decisions.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.body import Model
from imocap_core.conventions import LIMB_BONES, SIDES, SMPL_JOINTS
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState

LENGTH_COUNTS = (2.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0)  # of each of `length_rates` in a body


@dataclass(frozen=True)
class ShapePrior:
    """``beta^T precision beta``: beta is in standard deviations of the population."""

    precision: Float[Tensor, "n n"]

    @classmethod
    def of_body(
        cls, model: Model, weight: float, hidden_weight: float, size_weight: float
    ) -> ShapePrior:
        """``weight`` along the proportions that keypoints tell, ``size_weight`` along size,
        ``hidden_weight`` along the form of the torso."""
        hidden, size = hidden_directions(model), size_direction(model)
        of_form, of_size = hidden @ hidden.T, torch.outer(size, size)
        of_proportions = torch.eye(model.num_betas).to(hidden) - of_form - of_size
        return cls(weight * of_proportions + hidden_weight * of_form + size_weight * of_size)

    def of(self, v: int, frames: int) -> ShapePrior:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        precision = self._precision(state)
        cost = torch.einsum("bi,ij,bj->b", state.betas, precision, state.betas)
        others = state.other_betas
        if others.shape[1]:
            cost = cost + torch.einsum("bpi,ij,bpj->b", others, precision, others)
        return cost

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """A constant block for every performer."""
        precision = self._precision(state)
        for performer in range(1 + state.other_betas.shape[1]):
            columns = state.shape_columns(performer)
            normal.corner[:, columns, columns] += precision
            normal.corner_gradient[:, columns] += state.of_performer(performer).betas @ precision

    def _precision(self, state: MotionState) -> Float[Tensor, "n n"]:
        return self.precision.to(state.betas)


def hidden_directions(model: Model) -> Float[Tensor, "n k"]:
    """Orthonormal directions of shape that leave the lengths between the twelve joints, and so
    their size, as they are."""
    _, singular, rows = torch.linalg.svd(length_rates(model))
    rank = int((singular > 1e-6 * singular[0]).sum())
    return rows[rank:].T


def size_direction(model: Model) -> Float[Tensor, " n"]:
    """Unit vector of shape coefficients along which the lengths between the twelve joints grow
    most, all together.

    Those alone: feet, hands and neck, which no keypoint tells, would shrink to make up for limbs.
    """
    rates = length_rates(model)
    longer = rates.T @ rates.new_tensor(LENGTH_COUNTS)
    return longer / torch.linalg.vector_norm(longer)


def length_rates(model: Model) -> Float[Tensor, "7 n"]:
    """Metres per unit of each coefficient of what the twelve joints tell of a shape: limbs, both
    sides alike, the widths of hips and shoulders, the trunk between them."""
    points = {
        name: (model.joints_template[k], model.joints_shapedirs[k, :, : model.num_betas])
        for k, name in enumerate(SMPL_JOINTS)
    }
    for part in ("hip", "shoulder"):
        left, right = (points[f"{side}_{part}"] for side in SIDES)
        points[part] = ((left[0] + right[0]) / 2, (left[1] + right[1]) / 2)

    def rate(start: str, end: str) -> Float[Tensor, " n"]:
        bone = points[end][0] - points[start][0]
        growth = points[end][1] - points[start][1]
        return (bone / torch.linalg.vector_norm(bone)) @ growth

    limbs = [
        torch.stack([rate(f"{s}_{a}", f"{s}_{b}") for s in SIDES]).mean(0) for a, b in LIMB_BONES
    ]
    widths = [rate(f"right_{part}", f"left_{part}") for part in ("hip", "shoulder")]
    return torch.stack([*limbs, *widths, rate("hip", "shoulder")])
