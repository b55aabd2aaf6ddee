"""Rigid alignment of poses (Kabsch 1976), frame by frame or with a rotation that changes slowly."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d


def centred(
    poses: Float[np.ndarray, "N J 3"], weights: Float[np.ndarray, "N J"]
) -> Float[np.ndarray, "N J 3"]:
    """Poses about their weighted centroid; joints of weight 0 (NaN allowed) as 0."""
    x = np.where(weights[..., None] > 0, poses, 0.0)
    total = np.maximum(weights.sum(axis=1), 1e-12)[:, None, None]
    about: np.ndarray = x - (weights[..., None] * x).sum(axis=1, keepdims=True) / total
    return np.where(weights[..., None] > 0, about, 0.0)


def rotations_onto(
    poses: Float[np.ndarray, "N J 3"],
    targets: Float[np.ndarray, "N J 3"],
    weights: Float[np.ndarray, "N J"],
    window: float = 0.0,
) -> Float[np.ndarray, "N 3 3"]:
    """R_target_from_pose, the best rotation of each centred pose onto its target.

    With `window` > 0 each frame is aligned together with its neighbours, weighted by a Gaussian of
    that many frames: an orientation that changes slowly.
    """
    S = np.einsum("njk,njl->nkl", weights[..., None] * targets, poses)
    if window > 0:
        S = gaussian_filter1d(S, window, axis=0, mode="nearest")
    U, _, Vt = np.linalg.svd(S)
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    rotations: np.ndarray = U @ Vt
    return rotations
