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


def cauchy(squared: Tensor, scale: float) -> tuple[Tensor, Tensor]:
    """Cauchy loss and its IRLS weight: Student's t as a cost.

    Args:
        squared: (...) squared residual norms.
        scale: residual norm beyond which the loss turns from quadratic to logarithmic.

    Returns:
        cost: (...) ``scale^2 log(1 + s / scale^2)``; equals ``s`` for small residuals.
        weight: (...) its derivative in ``s``, in (0, 1].
    """
    return scale**2 * torch.log1p(squared / scale**2), scale**2 / (scale**2 + squared)
