"""Robust losses as (cost, weight) pairs for iteratively reweighted least squares."""

import torch
from torch import Tensor


def geman_mcclure(squared: Tensor, scale: float) -> tuple[Tensor, Tensor]:
    """Geman-McClure loss of Eq. 3 and its IRLS weight.

    Args:
        squared: (...) squared residual norms, in units of the noise's standard deviation.
        scale: residual norm at which the loss reaches half of its ceiling, same unit.

    Returns:
        cost: (...) ``scale^2 s / (scale^2 + s)``; equals ``s`` for small residuals.
        weight: (...) its derivative in ``s``, in (0, 1]: 1 for inliers, 0 for outliers.
    """
    ratio = scale**2 / (scale**2 + squared)
    return squared * ratio, ratio**2


def quadratic(squared: Tensor) -> tuple[Tensor, Tensor]:
    """The squared loss: cost ``s``, weight 1."""
    return squared, torch.ones_like(squared)
