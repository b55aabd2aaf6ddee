"""Shot boundary detection: cuts between two shots of a video.

A cut is a step between two frames across which no frames look alike, while the frames on either
side of it look alike among themselves. So a flash is not a cut (the frames before and after it look
alike), and neither is a fast pan (none of its frames look alike).
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Float, UInt8

THUMB = (48, 27)  # width, height
SHIFTS = tuple((dx, dy) for dx in (-6, -4, -2, 0, 2, 4, 6) for dy in (-2, 0, 2))
UNLIKE = 0.75  # correlation of two thumbnails of different shots is below it,
ALIKE = 0.85  # of neighbouring frames of one shot above it
TIMES = 4.0  # and a cut's 1 - correlation is this many times theirs


def thumbnail(gray: UInt8[np.ndarray, "H W"]) -> Float[np.ndarray, "27 48"]:
    """A grey picture reduced in size, with mean 0 and standard deviation 1."""
    small = cv2.resize(gray, THUMB, interpolation=cv2.INTER_AREA).astype(np.float64)
    blurred = np.asarray(cv2.GaussianBlur(small, (0, 0), 0.8), np.float64)
    centred = blurred - blurred.mean()
    spread = float(centred.std())
    return centred / spread if spread > 1.0 else np.zeros_like(centred)


def best_correlation(a: Float[np.ndarray, "27 48"], b: Float[np.ndarray, "27 48"]) -> float:
    """Best correlation of two thumbnails over small shifts, at most 1; 1 when both are blank."""
    if not a.any() and not b.any():
        return 1.0
    return max(_shifted_correlation(a, b, dx, dy) for dx, dy in SHIFTS)


def find_cuts(pictures: Iterable[UInt8[np.ndarray, "H W"]]) -> list[int]:
    """Indices of the pictures (grey, of one size) with which a new shot begins."""
    thumbs = [thumbnail(picture) for picture in pictures]
    steps = [best_correlation(a, b) for a, b in pairwise(thumbs)]
    cuts = []
    for t in range(1, len(thumbs)):  # between t - 1 and t
        if steps[t - 1] > UNLIKE:
            continue
        near = steps[max(0, t - 2) : t - 1] + steps[t : t + 1]
        if near and (min(near) < ALIKE or 1 - steps[t - 1] < TIMES * (1 - min(near))):
            continue
        around = [
            best_correlation(thumbs[a], thumbs[b])
            for a in range(max(0, t - 2), t)
            for b in range(t, min(len(thumbs), t + 3))
        ]
        if max(around) < ALIKE:
            cuts.append(t)
    return cuts


def _shifted_correlation(a: np.ndarray, b: np.ndarray, dx: int, dy: int) -> float:
    """Correlation over the part that both show when b is moved by (dx, dy)."""
    h, w = a.shape
    x = slice(max(0, dx), min(w, w + dx)), slice(max(0, -dx), min(w, w - dx))
    y = slice(max(0, dy), min(h, h + dy)), slice(max(0, -dy), min(h, h - dy))
    u, v = a[y[0], x[0]], b[y[1], x[1]]
    u, v = u - u.mean(), v - v.mean()
    size = float(np.sqrt((u * u).sum() * (v * v).sum()))
    return float((u * v).sum()) / size if size > 1e-9 else 0.0
