"""Shot boundaries, and whether points move as the picture does.

Shot boundary detection: cuts between two shots of a video. A cut is a step between two frames
across which no frames look alike, while the frames on either side of it look alike among
themselves. So a flash is not a cut (the frames before and after it look alike), and neither is a
fast pan (none of its frames look alike).

Whether points move as the picture does: where keypoints are of this picture, they do. Optical flow
(pyramidal Lucas-Kanade) at the points from one picture to a later one, against the points' own
displacements. Points of another size, another moment or another video lie on the background, or on
another part of the body, which moves otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

THUMB = (48, 27)  # width, height
SHIFTS = tuple((dx, dy) for dx in (-6, -4, -2, 0, 2, 4, 6) for dy in (-2, 0, 2))
LEAST_CORRELATION = 0.75  # correlation of two thumbnails of different shots is below it,
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
    cuts = []
    for t in range(1, len(thumbs)):  # between t - 1 and t
        before, after = thumbs[t - 1 : t + 1]
        if _shifted_correlation(before, after, 0, 0) > LEAST_CORRELATION:
            continue  # alike as they are: no shifts are needed
        step = best_correlation(before, after)
        if step > LEAST_CORRELATION:
            continue
        beside = thumbs[max(0, t - 2) : t], thumbs[t : t + 2]
        near = [best_correlation(*pair) for pair in beside if len(pair) == 2]
        if near and (min(near) < ALIKE or 1 - step < TIMES * (1 - min(near))):
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


WINDOW_PX, LEVELS = 15, 3
LONGEST = 0.1  # of the picture's larger side: a longer displacement counts as so long
LEAST_PX = 0.5  # root mean square of the displacements, below which nothing can be told

Picture = UInt8[np.ndarray, "height width"]
Points = Float[np.ndarray, "_ 2"]


class Agreement:
    """Correlation of the points' displacements with the flow there, over any number of pairs of
    pictures, for several readings of the points at once."""

    def __init__(self, readings: int) -> None:
        self._sums = np.zeros((readings, 3))  # of moved x flow, moved^2, flow^2
        self._count = np.zeros(readings, int)

    def add(self, before: Picture, after: Picture, points: Sequence[tuple[Points, Points]]) -> None:
        """An earlier and a later picture, and of each reading the points in each."""
        flow = _flow(before, after, np.concatenate([start for start, _ in points]))
        longest, row = LONGEST * max(before.shape), 0
        for k, (start, end) in enumerate(points):
            moved = _at_most(end - start, longest)
            flowed = _at_most(flow[row : row + len(start)], longest)
            row += len(start)
            self._sums[k] += [
                (a * b).sum() for a, b in ((moved, flowed), (moved, moved), (flowed, flowed))
            ]
            self._count[k] += len(start)

    def values(self) -> list[float]:
        """From -1 to 1; NaN where the points hardly move."""
        together, moved, flowed = self._sums.T
        with np.errstate(invalid="ignore", divide="ignore"):
            value = together / np.maximum(np.sqrt(moved * flowed), 1e-9)
        moves = moved > np.maximum(self._count, 1) * LEAST_PX**2
        return [
            float(v) if moving else float("nan") for v, moving in zip(value, moves, strict=True)
        ]


def _flow(before: Picture, after: Picture, points: Points) -> Points:
    """Optical flow at points; 0 outside the picture, and where it cannot be followed."""
    if not len(points):
        return np.zeros((0, 2))
    start = points.astype(np.float32)[:, None]
    end, status, _ = cv2.calcOpticalFlowPyrLK(
        before, after, start, start.copy(), winSize=(WINDOW_PX, WINDOW_PX), maxLevel=LEVELS
    )
    inside = ((points >= 0) & (points <= np.array(before.shape[::-1]) - 1)).all(axis=1)
    followed = (status[:, 0].astype(bool) & inside)[:, None]
    return np.where(followed, (end - start)[:, 0], 0.0)


def _at_most(vectors: Points, longest: float) -> Points:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors * np.minimum(1.0, longest / np.maximum(lengths, 1e-9))
