"""What the encoders see: 2D poses or small pictures of the performer, freed of place and size."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Clip = NDArray[np.float32]  # (T, ...) one item a frame
Picture = NDArray[np.uint8]

FRAME_SIZE = 64
_MARGIN = 1.15  # side of the crop over the larger side of the person's box


def pose_clip(xy_px: Array, confidence: Array, root: Sequence[int]) -> Clip:
    """Keypoints about the performer's root, in units of the performer's size: (T, K, 3) of x, y and
    confidence.

    `xy_px` (T, K, 2), `confidence` (T, K) in [0, 1]; `root`: the columns whose mean is the root
    (the hips). The size is the median over the clip, so that crouching stays visible. A missing
    joint is zero with confidence zero. ValueError when the root is never seen.
    """
    if xy_px.shape != (*confidence.shape, 2) or not len(root):
        raise ValueError(
            f"expected xy_px (T, K, 2), confidence (T, K) and a root column, got {xy_px.shape}, "
            f"{confidence.shape}, {list(root)}"
        )
    trust = np.where(np.isfinite(xy_px).all(axis=-1), np.nan_to_num(confidence), 0.0)
    seen = trust > 0
    centre = np.where(seen[:, root, None], xy_px[:, root], np.nan)
    rooted = seen[:, root].any(axis=1)
    if not rooted.any():
        raise ValueError("the root is never seen: a clip needs the hips in a frame at least")
    mean = np.full((len(xy_px), 2), np.nan)
    mean[rooted] = np.nanmean(centre[rooted], axis=1)
    about = np.nan_to_num(xy_px) - _bridged(mean)[:, None]
    reach = np.sqrt((trust[..., None] * about**2).sum((1, 2)) / np.maximum(trust.sum(1), 1e-9))
    size = max(float(np.median(reach[rooted])), 1e-9)
    items = np.concatenate([about / size * seen[..., None], trust[..., None]], axis=-1)
    return np.asarray(items, np.float32)


def person_squares(boxes_px: Array) -> Array:
    """Squares to cut out of each frame (T, 3): centre x, y and side, from boxes (T, 4) x0 y0 x1 y1.

    Unseen frames (NaN) are bridged; the side is one for the whole clip, so that size tells the
    pose. ValueError when the performer is never seen.
    """
    if not np.isfinite(boxes_px).all(axis=1).any():
        raise ValueError("no frame has a box around the person")
    centre = _bridged((boxes_px[:, :2] + boxes_px[:, 2:]) / 2)
    larger = (boxes_px[:, 2:] - boxes_px[:, :2]).max(axis=1)
    side = _MARGIN * float(np.nanpercentile(larger, 95))
    return np.column_stack([centre, np.full(len(centre), side)])


def person_crop(picture: Picture, square: Array, size: int = FRAME_SIZE) -> Picture:
    """The grey picture (height, width) inside a square (3,) as (size, size); edges are repeated."""
    x, y, side = square
    scale = size / max(float(side), 1.0)
    corner = (size - 1) / 2
    affine = np.array([[scale, 0.0, corner - scale * x], [0.0, scale, corner - scale * y]])
    if scale < 1.0:  # blur first, or thin limbs alias
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.5 / scale), np.uint8)
    crop = cv2.warpAffine(picture, affine, (size, size), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(crop, np.uint8)


def frame_clip(crops: Sequence[Picture]) -> Clip:
    """Crops (T of (S, S)) as (T, 1, S, S), with the clip's mean 0 and standard deviation 1."""
    stack = np.asarray(np.stack(crops), np.float32)[:, None]
    return np.asarray((stack - stack.mean()) / max(float(stack.std()), 1e-6), np.float32)


def _bridged(path: Array) -> Array:
    """Missing rows (NaN) of (T, 2) interpolated, the ends held."""
    known = np.isfinite(path).all(axis=1)
    at = np.arange(len(path))
    return np.column_stack([np.interp(at, at[known], column[known]) for column in path.T])
