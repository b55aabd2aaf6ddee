"""Automatic differentiation of the body, which `imocap benchmark speed` is compared with."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from imocap_core.body import Model, PointSet
from imocap_core.rotations import exp

LAYOUT = "body25"


def automatic_jacobian(
    model: Model, points: PointSet
) -> Callable[[Tensor, Tensor, Tensor], object]:
    """Forward-mode Jacobian of each body's keypoints by its pose, shape and translation."""

    def place(theta: Tensor, betas: Tensor, transl: Tensor) -> Tensor:
        return model.shape(betas).pose(exp(theta), transl).keypoints(points)

    jacobian = torch.func.jacfwd(place, argnums=(0, 1, 2))
    return torch.func.vmap(jacobian, in_dims=(0, None, 0))
