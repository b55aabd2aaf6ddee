"""Robust losses and their weights, of numpy arrays and of torch tensors alike.

With ``s`` the square of a residual, a robust loss ``rho(s)`` equals ``s`` for small residuals and
grows slower for large ones. Least squares with the weight ``w = d rho / d s``, found anew in each
step, minimises it (iteratively reweighted least squares).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:  # torch takes a second to import, and numpy's callers do not need it
    from torch import Tensor

    Values = TypeVar("Values", NDArray[np.float64], Tensor)
else:
    Values = TypeVar("Values")


def geman_mcclure(squared: Values, scale: float) -> tuple[Values, Values]:
    """Geman-McClure loss (Eq. 3) and its derivative.

    Args:
        squared: (...) squared residual norms, at least 0.
        scale: residual norm at which the loss reaches half of its ceiling ``scale^2``.

    Returns:
        cost: (...) ``scale^2 s / (scale^2 + s)``; weight: (...) its derivative by ``s``,
        ``(scale^2 / (scale^2 + s))^2``, in (0, 1]: 1 for inliers, 1/4 at ``scale``, 0 for outliers.
    """
    root = scale**2 / (scale**2 + squared)
    return squared * root, root**2


def geman_mcclure_weight(residual: Values, scale: float, prior: Values | float = 1.0) -> Values:
    """The same weight (...) from residuals instead of their squares, times a prior weight."""
    return prior / (1.0 + (residual / scale) ** 2) ** 2


def cauchy(squared: Values, scale: float) -> tuple[Values, Values]:
    """Cauchy loss, the likelihood of Student's t as a cost, and its derivative.

    Args:
        squared: (...) squared residual norms.
        scale: residual norm beyond which the loss turns from quadratic to logarithmic.

    Returns:
        cost: (...) ``scale^2 log(1 + s / scale^2)``; weight: (...) its derivative by ``s``,
        ``scale^2 / (scale^2 + s)``, in (0, 1].
    """
    share = squared / scale**2
    log = np.log1p(share) if isinstance(share, np.ndarray) else share.log1p()
    return scale**2 * log, scale**2 / (scale**2 + squared)


def finite_median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Medians of (..., W) over the last axis without NaN (`np.nanmedian`, faster), where each row
    has a number."""
    ordered = np.sort(values, axis=-1)  # NaN last
    count = np.isfinite(values).sum(-1, keepdims=True)
    low, high = (np.take_along_axis(ordered, k, -1)[..., 0] for k in ((count - 1) // 2, count // 2))
    return np.asarray(0.5 * (low + high))
