"""Inputs of the encoders: 2D poses or small pictures of the performer, normalised in place and
size."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

TccClip = Float32[np.ndarray, "T ..."]  # a pose or a picture for each frame

FRAME_SIZE = 64
_MARGIN = 1.15  # side of the crop over the larger side of the person's box


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


def person_squares(boxes_px: Float[np.ndarray, "T 4"]) -> Float[np.ndarray, "T 3"]:
    """Squares to cut out of each frame: centre x, y and side, from boxes x0 y0 x1 y1.

    Frames without the performer (NaN) are interpolated; all squares have one side, so that the
    performer's size in them depends on the pose alone. ValueError when no frame has a box.
    """
    if not np.isfinite(boxes_px).all(axis=1).any():
        raise ValueError("no frame has a box around the person")
    centre = _interpolated((boxes_px[:, :2] + boxes_px[:, 2:]) / 2)
    larger = (boxes_px[:, 2:] - boxes_px[:, :2]).max(axis=1)
    side = _MARGIN * float(np.nanpercentile(larger, 95))
    return np.column_stack([centre, np.full(len(centre), side)])


def person_crop(
    picture: UInt8[np.ndarray, "H W"], square: Float[np.ndarray, " 3"], size: int = FRAME_SIZE
) -> UInt8[np.ndarray, "S S"]:
    """The part of a grey picture inside a square, resized to (size, size); edges are repeated."""
    x, y, side = square
    scale = size / max(float(side), 1.0)
    corner = (size - 1) / 2
    affine = np.array([[scale, 0.0, corner - scale * x], [0.0, scale, corner - scale * y]])
    if scale < 1.0:  # blur first, or thin limbs alias
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.5 / scale), np.uint8)
    crop = cv2.warpAffine(picture, affine, (size, size), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(crop, np.uint8)


def frame_clip(crops: Sequence[UInt8[np.ndarray, "S S"]]) -> Float32[np.ndarray, "T 1 S S"]:
    """The crops of a clip, with mean 0 and standard deviation 1 over the clip."""
    stack = np.asarray(np.stack(crops), np.float32)[:, None]
    return np.asarray((stack - stack.mean()) / max(float(stack.std()), 1e-6), np.float32)


def _interpolated(path: np.ndarray) -> np.ndarray:
    """Missing rows (NaN) of (T, 2) interpolated, the ends repeated."""
    present = np.isfinite(path).all(axis=1)
    frames = np.arange(len(path))
    return np.column_stack(
        [np.interp(frames, frames[present], column[present]) for column in path.T]
    )
