"""Distances in each video's own axes: what a camera sees well counts more than what it guesses.

A monocular estimate is far less certain along the line of sight than across it, and its orientation
drifts slowly. Rigid alignment frame by frame can use neither fact: it spreads the error in depth
over all directions and lets every frame turn as it likes. Once a video is roughly synchronised, the
rotation between it and the template is a smooth function of time, and the residuals tell how
certain each of its axes is. With both known the distance is a plain weighted one, a matrix product.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

Array = NDArray[np.float64]


def centred(poses: Array, weights: Array) -> Array:
    """Poses (n, J, 3) about their weighted centroid; joints of weight 0 (NaN allowed) as 0."""
    x = np.where(weights[..., None] > 0, poses, 0.0)
    total = np.maximum(weights.sum(axis=1), 1e-12)[:, None, None]
    about: Array = x - (weights[..., None] * x).sum(axis=1, keepdims=True) / total
    return np.where(weights[..., None] > 0, about, 0.0)


def rotations_onto(poses: Array, targets: Array, weights: Array, window: float = 0.0) -> Array:
    """R_target_from_pose (n, 3, 3), the best rigid alignment of centred poses (n, J, 3).

    With `window` > 0 each frame is aligned together with its neighbours, weighted by a Gaussian of
    that many frames: an orientation that changes slowly.
    """
    S = np.einsum("njk,njl->nkl", weights[..., None] * targets, poses)
    if window > 0:
        S = gaussian_filter1d(S, window, axis=0, mode="nearest")
    U, _, Vt = np.linalg.svd(S)
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    rotations: Array = U @ Vt
    return rotations


def axis_precisions(residuals: Array, weights: Array) -> Array:
    """How certain each axis is (3,), inverse variance with mean 1, from residuals (n, J, 3).

    The variances are squared medians of absolute residuals, which outliers don't move; no axis
    counts more than ten times another.
    """
    seen = residuals[weights > 0]
    if len(seen) == 0:
        return np.ones(3)
    variance = np.median(np.abs(seen), axis=0) ** 2
    precision = 1.0 / np.maximum(variance, max(0.1 * float(variance.max()), 1e-18))
    return np.asarray(precision * 3.0 / precision.sum())


def squared_distances_in_view(
    poses: Array, weights: Array, others: Array, others_weights: Array, maps: Array, window: float
) -> Array:
    """Mean squared joint distance (n, S) of a video's frames to a template, in the video's axes.

    `poses` (n, J, 3), `others` (S, J, 3), their weights (n, J) and (S, J); `maps` (n, S) says where
    the frames lie so far (each row any scale), `window` in frames as in `rotations_onto`. NaN where
    no joint is shared.
    """
    n, S = maps.shape
    x, y = centred(poses, weights), centred(others, others_weights)
    share = maps / np.maximum(maps.sum(axis=1, keepdims=True), 1e-12)
    targets = (share @ y.reshape(S, -1)).reshape(x.shape)
    both = weights * (share @ others_weights)
    R = rotations_onto(x, targets, both, window)
    precision = axis_precisions(x - np.einsum("nab,nja->njb", R, targets), both)

    # (x - R'y)' P (x - R'y) = x'Px - 2 (RPx)'y + y'(RPR')y, summed over the shared joints
    RPR = np.einsum("nab,b,ncb->nac", R, precision, R)
    RPx = np.einsum("nab,njb->nja", R * precision, x) * weights[..., None]
    yy = np.einsum("sja,sjb->sjab", y, y) * others_weights[..., None, None]
    square = (weights * (x * x * precision).sum(axis=-1)) @ others_weights.T
    square -= 2.0 * RPx.reshape(n, -1) @ (y * others_weights[..., None]).reshape(S, -1).T
    square += (weights[..., None] * RPR.reshape(n, 1, 9)).reshape(n, -1) @ yy.reshape(S, -1).T
    shared = weights @ others_weights.T
    mean = np.maximum(square, 0.0) / np.where(shared > 0, shared, 1.0)
    return np.where(shared > 0, mean, np.nan)
