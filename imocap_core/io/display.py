"""How the stored pictures of a video are shown: with square pixels, then turned or reflected.

A file may say that its pixels are not square (tapes, DVDs) and how players place the picture
(phones held sideways, front cameras, a flip in an editor). Everything that follows works on the
picture as it is shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import av
import numpy as np
from jaxtyping import Float, Int, UInt8

SQUARE = 0.01  # nearer to 1, an aspect ratio is that of square pixels in a rounded size
WIDEST = 5.0  # a pixel that is longer than this in one direction is a damaged header
UPRIGHT = ((1, 0), (0, 1))


@dataclass(frozen=True)
class Display:
    """Attributes:
    stored: width and height of the pictures in the file, pixels.
    aspect: width of a stored pixel over its height.
    axes: rows of the signed permutation that takes stored directions (x right, y down) to shown
        ones.
    """

    stored: tuple[int, int]
    aspect: float = 1.0
    axes: tuple[tuple[int, int], tuple[int, int]] = UPRIGHT

    @property
    def square(self) -> tuple[int, int]:
        """Width and height of the stored picture with square pixels."""
        return max(1, round(self.aspect * self.stored[0])), self.stored[1]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the shown picture."""
        width, height = self.square
        return (height, width) if self.axes[0][0] == 0 else (width, height)

    @property
    def mirrored(self) -> bool:
        """Whether the shown picture is the mirror image of the stored one."""
        (a, b), (c, d) = self.axes
        return a * d - b * c < 0

    def shown(self, picture: UInt8[np.ndarray, "..."]) -> UInt8[np.ndarray, "..."]:
        """A picture with square pixels as it is shown."""
        (a, b), (c, d) = self.axes
        if a == 0:
            picture = np.swapaxes(picture, 0, 1)
        picture = picture[:: c + d, :: a + b]
        return np.ascontiguousarray(picture)

    def shown_points(self, stored_px: Float[np.ndarray, "*any 2"]) -> Float[np.ndarray, "*any 2"]:
        """Pixels of the shown picture from those of the stored one."""
        middle = 0.5 * (np.array(self.stored) - 1)
        square = (stored_px - middle) * np.divide(self.square, self.stored)
        return square @ np.array(self.axes, float).T + 0.5 * (np.array(self.size) - 1)


@dataclass(frozen=True)
class ShownFrame:
    """A decoded frame and how it is shown."""

    frame: av.VideoFrame
    display: Display

    def rgb(self) -> UInt8[np.ndarray, "height width 3"]:
        """The picture in its full size."""
        width, height = self.display.square
        if (self.frame.width, self.frame.height) == (width, height):
            return self.display.shown(np.asarray(self.frame.to_ndarray(format="rgb24"), np.uint8))
        return self.small("rgb24", 1.0)

    def small(self, format: str, scale: float) -> UInt8[np.ndarray, "..."]:
        """The picture resized by ``scale``: `gray` or `rgb24`."""
        width, height = (max(1, round(scale * side)) for side in self.display.square)
        small = self.frame.reformat(width=width, height=height, format=format, interpolation="AREA")
        return self.display.shown(np.asarray(small.to_ndarray(), np.uint8))


def display_of(frame: av.VideoFrame, aspect: float | None) -> Display:
    """How a file's frames are shown; ``aspect``: of a stored pixel, None where it is not said."""
    stored = frame.width, frame.height
    matrix: Any = frame.side_data.get("DISPLAYMATRIX")
    axes = UPRIGHT
    if matrix is not None:
        axes = axes_of(np.frombuffer(bytes(matrix), np.int32, 9).reshape(3, 3))
    return Display(stored, _aspect(aspect), axes)


def axes_of(
    matrix: Int[np.ndarray, "3 3"] | Sequence[Sequence[int]],
) -> tuple[tuple[int, int], tuple[int, int]]:
    """The signed permutation nearest to a display matrix, which maps rows [x y 1]."""
    linear = np.array(matrix, float)[:2, :2].T
    if abs(linear[0, 0] * linear[1, 1]) >= abs(linear[0, 1] * linear[1, 0]):
        return (_sign(linear[0, 0]), 0), (0, _sign(linear[1, 1]))
    return (0, _sign(linear[0, 1])), (_sign(linear[1, 0]), 0)


def _sign(value: float) -> int:
    return -1 if value < 0 else 1


def _aspect(aspect: float | None) -> float:
    """An aspect ratio that cameras have; 1 for one that nearly is, and for nonsense."""
    if aspect is None or not 1 / WIDEST <= aspect <= WIDEST or abs(aspect - 1) < SQUARE:
        return 1.0
    return aspect
