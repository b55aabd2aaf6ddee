"""How alike are two body poses? Distances over all pairs of frames, and affinities from them.

Paper, section 3.1 (above Eq. 1): "we compute the Euclidean distance between each pair of 3D poses
aligned by the Procrustes method. Then, we map the reciprocal of distance to a value between [0,1]".

The rotation that aligns two poses is never needed, only what is left after it, and that depends on
the 3x3 correlation matrix S of the two poses alone: with singular values s1 >= s2 >= s3 of S,

    min_R sum_j w_j |a_j - R b_j|^2 = |a|^2 + |b|^2 - 2 (s1 + s2 + sign(det S) s3).

So all pairs are one matrix product for the correlations and one closed form per entry.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ENTRIES_PER_CHUNK = (
    1 << 16
)  # pairs worked on at once: about 10 MB of temporaries, which stay in cache
MIN_SHARED_JOINTS = 3.0  # fewer joints seen in both frames can be aligned to almost anything


def optimal_trace(S: Array) -> Array:
    """max over rotations R of trace(R S), closed form, for S (3, 3, ...) -> (...).

    With e1, e2, d = the trace of S'S, the squared norm of S's cofactors, det S, the answer is the
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


def _moments(poses: Array, weights: Array) -> tuple[Array, Array]:
    """Weighted moments of each frame: (N, J, 5) [w x, w y, w z, w |x|^2, w], and the poses with
    NaN as 0."""
    x = np.where(weights[..., None] > 0, poses, 0.0)
    w = weights[..., None]
    return np.concatenate([w * x, w * (x * x).sum(-1, keepdims=True), w], axis=-1), x


def _pair_sums(rows: Array, cols: Array) -> tuple[Array, ...]:
    """Sums over the joints of both frames' moments for every pair: S (3, 3, n, m), |a|^2, |b|^2
    (centred), W (n, m)."""
    n, J, _ = rows.shape
    m = cols.shape[0]

    def product(p: slice | int, q: slice | int) -> Array:
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
    poses_a: Array,
    poses_b: Array,
    weights_a: Array,
    weights_b: Array,
    *,
    entries_per_chunk: int = ENTRIES_PER_CHUNK,
) -> Array:
    """Root-mean-square joint distance of every pair of poses after the best rigid alignment.

    `poses_*` (N, J, 3), any unit; `weights_*` (N, J) >= 0: a joint counts in a pair by the product
    of its two weights, so a joint missing (weight 0, NaN allowed) in either frame doesn't count.
    Returns (N_a, N_b) in the unit of the poses; NaN where the two frames share fewer than three
    joints. Both poses are centred on the joints they share.
    """
    if poses_a.ndim != 3 or poses_b.ndim != 3 or poses_a.shape[1:] != poses_b.shape[1:]:
        raise ValueError(
            f"poses: expected (N, J, 3) with equal J, got {poses_a.shape} and {poses_b.shape}"
        )
    moments_a, _ = _moments(poses_a, weights_a)
    moments_b, _ = _moments(poses_b, weights_b)
    seen_a, seen_b = (weights_a > 0).astype(float), (weights_b > 0).astype(float)
    out = np.empty((len(poses_a), len(poses_b)))
    step = max(1, entries_per_chunk // max(1, len(poses_b)))
    for start in range(0, len(poses_a), step):
        rows = slice(start, start + step)
        S, norm_a, norm_b, weight = _pair_sums(moments_a[rows], moments_b)
        square = norm_a + norm_b - 2.0 * optimal_trace(S)
        enough = seen_a[rows] @ seen_b.T >= MIN_SHARED_JOINTS
        mean = np.maximum(square, 0.0) / np.where(weight > 0, weight, 1.0)
        out[rows] = np.where(enough, np.sqrt(mean), np.nan)
    return out


def reciprocal_affinity(distance: Array, scale: float) -> Array:
    """The paper's map: the reciprocal of the distance, brought to [0, 1] as 1 / (1 + d / scale).

    1 at distance 0, 1/2 at `scale` (same unit as `distance`). Unknown distances (NaN) have
    affinity 0.
    """
    return np.nan_to_num(1.0 / (1.0 + distance / scale), nan=0.0)


def gaussian_affinity(distance: Array, scale: float) -> Array:
    """exp(-d^2 / (2 scale^2)): sharper than the reciprocal, 0.61 at `scale`. NaN distances have
    affinity 0."""
    return np.nan_to_num(np.exp(-0.5 * (distance / scale) ** 2), nan=0.0)
