"""Inputs of the encoder: 2D poses, normalised in place and size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32

TccClip = Float32[np.ndarray, "T K 3"]  # a pose for each frame


def pose_clip(
    xy_px: Float[np.ndarray, "T K 2"], confidence: Float[np.ndarray, "T K"], root: Sequence[int]
) -> Float32[np.ndarray, "T K 3"]:
    """Keypoints relative to the performer's root, in units of the performer's size: x, y and
    confidence.

    `confidence` in [0, 1]; `root`: the columns whose mean is the root (the hips). The size is the
    median over the clip, so that crouching stays visible. A missing joint is zero with confidence
    zero. ValueError when the root is missing in every frame.
    """
    if xy_px.shape != (*confidence.shape, 2) or not len(root):
        raise ValueError(
            f"expected xy_px (T, K, 2), confidence (T, K) and a root column, got {xy_px.shape}, "
            f"{confidence.shape}, {list(root)}"
        )
    weight = np.where(np.isfinite(xy_px).all(axis=-1), np.nan_to_num(confidence), 0.0)
    visible = weight > 0
    centre = np.where(visible[:, root, None], xy_px[:, root], np.nan)
    rooted = visible[:, root].any(axis=1)
    if not rooted.any():
        raise ValueError(
            "the root is missing in every frame: a clip needs the hips in one frame at least"
        )
    mean = np.full((len(xy_px), 2), np.nan)
    mean[rooted] = np.nanmean(centre[rooted], axis=1)
    about = np.nan_to_num(xy_px) - _interpolated(mean)[:, None]
    reach = np.sqrt((weight[..., None] * about**2).sum((1, 2)) / np.maximum(weight.sum(1), 1e-9))
    size = max(float(np.median(reach[rooted])), 1e-9)
    items = np.concatenate([about / size * visible[..., None], weight[..., None]], axis=-1)
    return np.asarray(items, np.float32)


def _interpolated(path: np.ndarray) -> np.ndarray:
    """Missing rows (NaN) of (T, 2) interpolated, the ends repeated."""
    present = np.isfinite(path).all(axis=1)
    frames = np.arange(len(path))
    return np.column_stack(
        [np.interp(frames, frames[present], column[present]) for column in path.T]
    )
