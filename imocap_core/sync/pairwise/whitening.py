"""Which combinations of joints an estimator gets wrong together, read from the residuals.

Wrists stray more than hips, and a limb strays as a whole: a distance that adds up all joints alike
counts one error several times. Residuals of the current alignment tell the covariance of the
joints' errors; features in which they are independent and equally large make the plain distance the
right one. Combining joints commutes with turning poses, so alignment works on features unchanged.
"""

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.pairwise.view_axes import axis_precisions, centred, rotations_onto

Array = NDArray[np.float64]

OFF_DIAGONAL = 0.8  # of the covariance between joints is believed: residuals are few
LEAST_VARIANCE = 0.02  # of the mean variance: no feature counts more than fifty times the usual one


def residuals_in_view(
    poses: Array, weights: Array, others: Array, others_weights: Array, maps: Array, window: float
) -> Array:
    """Poses (n, J, 3) less what the template (S, J, 3) expects of them, in the video's own axes.

    Arguments as of `squared_distances_in_view`.
    """
    S = maps.shape[1]
    x, y = centred(poses, weights), centred(others, others_weights)
    share = maps / np.maximum(maps.sum(axis=1, keepdims=True), 1e-12)
    targets = (share @ y.reshape(S, -1)).reshape(x.shape)
    R = rotations_onto(x, targets, weights * (share @ others_weights), window)
    return np.asarray(x - np.einsum("nab,nja->njb", R, targets))


def whitening(residuals: Array, weights: Array) -> Array:
    """(J, J) that turns joints into features of equal, independent errors; mean variance is kept.

    `residuals` (n, J, 3), `weights` (n, J). Frames far off count less. The identity where joints
    are missing in some frames: a combination of joints needs all of them.
    """
    J = residuals.shape[1]
    seen = (weights > 0).any(axis=1)
    complete = np.isfinite(residuals[seen]).all() and (weights[seen] == weights[seen, :1]).all()
    if seen.sum() < 3 * J or not complete:
        return np.eye(J)
    z = residuals[seen] * np.sqrt(axis_precisions(residuals, weights))
    size = (z * z).sum(axis=(1, 2))
    trust = 1.0 / (1.0 + size / max(float(np.median(size)), 1e-18))
    covariance = np.einsum("n,nja,nka->jk", trust, z, z) / (3.0 * trust.sum())
    diagonal = np.diag(np.diag(covariance))
    covariance = diagonal + OFF_DIAGONAL * (covariance - diagonal)
    mean = float(np.trace(covariance)) / J
    if not mean > 0:
        return np.eye(J)
    values, vectors = np.linalg.eigh(covariance / mean)
    return np.asarray((vectors / np.sqrt(values + LEAST_VARIANCE)) @ vectors.T)
