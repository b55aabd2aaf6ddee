"""Whitening of the joints: linear combinations of joints whose errors are independent and equal.

Wrists err more than hips, and a limb errs as a whole: a distance that adds up all joints alike
counts one error several times. The residuals of the current alignment give the covariance of the
joints' errors; for features in which they are independent and equally large, the plain distance is
the right one. Combining joints commutes with rotating poses, so alignment works on the features
unchanged.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.view_distance import axis_precisions

OFF_DIAGONAL = 0.8  # shrinkage of the covariances between joints: residuals are few
LEAST_VARIANCE = 0.02  # of the mean variance: no feature counts more than fifty times the usual one


def whitening(
    residuals: Float[np.ndarray, "N J 3"], weights: Float[np.ndarray, "N J"]
) -> Float[np.ndarray, "J J"]:
    """Matrix that turns joints into features of equal, independent errors; the mean variance stays.

    Frames with large residuals count less. The identity where joints are missing in some frames: a
    combination of joints needs all of them.
    """
    J = residuals.shape[1]
    visible = (weights > 0).any(axis=1)
    complete = (
        np.isfinite(residuals[visible]).all() and (weights[visible] == weights[visible, :1]).all()
    )
    if visible.sum() < 3 * J or not complete:
        return np.eye(J)
    z = residuals[visible] * np.sqrt(axis_precisions(residuals, weights))
    size = (z * z).sum(axis=(1, 2))
    robust = 1.0 / (1.0 + size / max(float(np.median(size)), 1e-18))
    covariance = np.einsum("n,nja,nka->jk", robust, z, z) / (3.0 * robust.sum())
    diagonal = np.diag(np.diag(covariance))
    covariance = diagonal + OFF_DIAGONAL * (covariance - diagonal)
    mean = float(np.trace(covariance)) / J
    if not mean > 0:
        return np.eye(J)
    values, vectors = np.linalg.eigh(covariance / mean)
    return np.asarray((vectors / np.sqrt(values + LEAST_VARIANCE)) @ vectors.T)
