"""Procrustes distance of every pair of poses, in closed form, and the alignment itself.

Only the residual of the rigid alignment is needed, not its rotation, and the residual depends on
nothing but the 3x3 correlation matrix S of the two centred poses: with its singular values
s1 >= s2 >= s3,

    min_R sum_j w_j |a_j - R b_j|^2 = |a|^2 + |b|^2 - 2 (s1 + s2 + sign(det S) s3).

So all pairs are one matrix product for the correlations and one closed form per entry.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

# pairs computed at once: about 10 MB of temporaries, which stay in cache
ENTRIES_PER_CHUNK = 1 << 16
MIN_SHARED_JOINTS = 3.0  # fewer joints visible in both frames can be aligned to almost anything


def optimal_trace(S: Float[np.ndarray, "3 3 *shape"]) -> Float[np.ndarray, "*shape"]:
    """max over rotations R of trace(R S), in closed form.

    With e1, e2, d = the trace of S'S, the squared norm of S's cofactors, det S, the maximum is the
    largest root of x^4 - 2 e1 x^2 - 8 d x + e1^2 - 4 e2 (Horn 1987; Theobald 2005). The singular
    values come from the trigonometric solution of the cubic of S'S; one Newton step on the quartic
    removes the rounding error of the cosine.
    """
    cof = [
        S[(i + 1) % 3, (j + 1) % 3] * S[(i + 2) % 3, (j + 2) % 3]
        - S[(i + 1) % 3, (j + 2) % 3] * S[(i + 2) % 3, (j + 1) % 3]
        for i in range(3)
        for j in range(3)
    ]
    det = S[0, 0] * cof[0] + S[0, 1] * cof[1] + S[0, 2] * cof[2]
    e1 = sum(S[i, j] ** 2 for i in range(3) for j in range(3))
    e2 = sum(c * c for c in cof)
    mean = e1 / 3.0
    spread = np.sqrt(np.maximum(mean * mean - e2 / 3.0, 0.0))
    q = mean**3 - 0.5 * mean * e2 + 0.5 * det * det
    cosine = np.divide(q, spread**3, out=np.ones_like(q), where=spread > 1e-9 * mean)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0)) / 3.0
    largest = mean + 2.0 * spread * np.cos(angle)
    smallest = mean - 2.0 * spread * np.cos(np.pi / 3.0 - angle)
    middle = e1 - largest - smallest
    s1, s2, s3 = (np.sqrt(np.maximum(x, 0.0)) for x in (largest, middle, smallest))
    x = s1 + s2 + np.sign(det) * s3
    slope = 4.0 * x * (x * x - e1) - 8.0 * det
    value = (x * x - e1) ** 2 - 8.0 * det * x - 4.0 * e2
    step = np.divide(value, slope, out=np.zeros_like(x), where=np.abs(slope) > 1e-3 * x**3)
    return np.asarray(x - step)


def _moments(poses: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted moments of each joint of each frame: (N, J, 5) [w x, w y, w z, w |x|^2, w]."""
    x = np.where(weights[..., None] > 0, poses, 0.0)
    w = weights[..., None]
    return np.concatenate([w * x, w * (x * x).sum(-1, keepdims=True), w], axis=-1)


def _pair_sums(rows: np.ndarray, cols: np.ndarray) -> tuple[np.ndarray, ...]:
    """Sums over the joints of both frames' moments for every pair: S (3, 3, n, m), |a|^2, |b|^2
    (centred), W (n, m)."""
    n, J, _ = rows.shape
    m = cols.shape[0]

    def product(p: slice | int, q: slice | int) -> np.ndarray:
        left, right = rows[:, :, p].reshape(n, J, -1), cols[:, :, q].reshape(m, J, -1)
        out = left.transpose(2, 0, 1).reshape(-1, J) @ right.transpose(1, 2, 0).reshape(J, -1)
        return out.reshape(left.shape[2], n, right.shape[2], m).transpose(0, 2, 1, 3)

    weight = product(4, 4)[0, 0]
    safe = np.maximum(weight, 1e-12)
    sum_a, sum_b = product(slice(0, 3), 4)[:, 0], product(4, slice(0, 3))[0]
    S = product(slice(0, 3), slice(0, 3)) - sum_a[:, None] * sum_b[None, :] / safe
    norm_a = product(3, 4)[0, 0] - (sum_a**2).sum(0) / safe
    norm_b = product(4, 3)[0, 0] - (sum_b**2).sum(0) / safe
    return S, norm_a, norm_b, weight


def procrustes_distances(
    poses_a: Float[np.ndarray, "N_a J 3"],
    poses_b: Float[np.ndarray, "N_b J 3"],
    weights_a: Float[np.ndarray, "N_a J"],
    weights_b: Float[np.ndarray, "N_b J"],
    *,
    turned: bool = True,
    entries_per_chunk: int = ENTRIES_PER_CHUNK,
) -> Float[np.ndarray, "N_a N_b"]:
    """Root-mean-square joint distance of every pair of poses after the best rigid alignment.

    Args:
        poses_a, poses_b: any unit; both are centred on the joints that they share.
        weights_a, weights_b: at least 0. A joint counts in a pair by the product of its two
            weights, so a joint missing (weight 0, NaN allowed) in either frame does not count.
        turned: whether the best alignment turns poses too, or only moves them.

    Returns:
        In the unit of the poses; NaN where the two frames share fewer than three joints.

    Raises:
        ValueError: the poses' shapes do not fit.
    """
    if poses_a.ndim != 3 or poses_b.ndim != 3 or poses_a.shape[1:] != poses_b.shape[1:]:
        raise ValueError(
            f"poses: expected (N, J, 3) with equal J, got {poses_a.shape} and {poses_b.shape}"
        )
    moments_a, moments_b = _moments(poses_a, weights_a), _moments(poses_b, weights_b)
    visible_a, visible_b = (weights_a > 0).astype(float), (weights_b > 0).astype(float)
    out = np.empty((len(poses_a), len(poses_b)))
    step = max(1, entries_per_chunk // max(1, len(poses_b)))
    for start in range(0, len(poses_a), step):
        rows = slice(start, start + step)
        S, norm_a, norm_b, weight = _pair_sums(moments_a[rows], moments_b)
        trace = optimal_trace(S) if turned else np.trace(S)
        square = norm_a + norm_b - 2.0 * trace
        enough = visible_a[rows] @ visible_b.T >= MIN_SHARED_JOINTS
        mean = np.maximum(square, 0.0) / np.where(weight > 0, weight, 1.0)
        out[rows] = np.where(enough, np.sqrt(mean), np.nan)
    return out


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
