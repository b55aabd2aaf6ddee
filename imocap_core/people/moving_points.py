"""Whether points move as the picture does: where keypoints are of this picture, they do.

Optical flow (pyramidal Lucas-Kanade) at the points from one picture to a later one, against the
points' own displacements. Points of another size, another moment or another video lie on the
background, or on another part of the body, which moves otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

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
