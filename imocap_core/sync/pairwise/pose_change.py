"""Change of a video's pose around each frame: near 0 while the performer stands still."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

CHANGE_S = 0.5  # means over this long before and after a frame are compared


def pose_change(
    poses: Float[np.ndarray, "T J 3"], weights: Float[np.ndarray, "T J"], fps: float
) -> Float[np.ndarray, " T"]:
    """Mean squared distance of the mean poses before and after each frame, after the best rigid
    alignment; at the ends of the nearest frame with both."""
    T = len(poses)
    span = max(1, min(round(CHANGE_S * fps), (T - 1) // 2))
    if T < 3:
        return np.full(T, np.inf)
    w = weights[..., None]
    moments = np.concatenate([np.where(w > 0, poses, 0.0) * w, w], axis=-1)
    total = np.concatenate([np.zeros((1, *moments.shape[1:])), np.cumsum(moments, axis=0)])
    t = np.clip(np.arange(T), span, T - 1 - span)
    before, after = total[t] - total[t - span], total[t + span + 1] - total[t + 1]
    a, b = (m[..., :3] / np.maximum(m[..., 3:], 1e-9) for m in (before, after))
    return _squared_distances(a, b, np.minimum(before[..., 3], after[..., 3]))


def _squared_distances(a: np.ndarray, b: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Mean squared joint distance (T,) of poses (T, J, 3) after the best rigid alignment."""
    total = np.maximum(weights.sum(axis=1), 1e-9)
    x, y = (p - ((p * weights[..., None]).sum(axis=1) / total[:, None])[:, None] for p in (a, b))
    S = np.einsum("tj,tja,tjb->tab", weights, x, y)
    values = np.linalg.svd(S, compute_uv=False)
    best = values[:, 0] + values[:, 1] + np.sign(np.linalg.det(S)) * values[:, 2]
    square = (weights * ((x**2).sum(-1) + (y**2).sum(-1))).sum(axis=1) - 2.0 * best
    return np.asarray(np.maximum(square, 0.0) / total)
