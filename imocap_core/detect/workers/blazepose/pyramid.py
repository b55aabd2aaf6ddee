"""A picture, and itself at half the size, as often as its crops ask for (an image pyramid)."""

from __future__ import annotations

import cv2
import numpy as np


class Pyramid:
    """A picture (H, W, 3), RGB; smaller ones are made when they are first needed."""

    def __init__(self, full: np.ndarray) -> None:
        """full: the picture as it was filmed."""
        self._sizes = [full]

    @property
    def shape(self) -> tuple[int, ...]:
        """Height, width and colours."""
        return self._sizes[0].shape

    @property
    def nbytes(self) -> int:
        """Of all its sizes."""
        return sum(pixels.nbytes for pixels in self._sizes)

    def halved(self, times: int) -> np.ndarray:
        """The picture at 1 / 2^times of its size: each pixel the mean of those that it covers; an
        odd row or column at the end is left out."""
        while len(self._sizes) <= times:
            last = self._sizes[-1]
            height, width = (side // 2 for side in last.shape[:2])
            even = last[: 2 * height, : 2 * width]
            self._sizes.append(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA))
        return self._sizes[times]
