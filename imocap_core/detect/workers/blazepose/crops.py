"""Square crops about a person: where they lie in the picture, and their pixels.

A crop turns with the person, so that the networks get an upright body. Positions are pixels of the
picture; a pixel covers the square from its number to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from .pyramid import Pyramid

MARGIN = 1.25  # side of a crop / diameter of the circle about the whole body (BlazePose's)
SAME_PLACE = 0.15  # of the side
SAME_SIDE = 1.25
SAME_ANGLE = math.radians(25)


@dataclass(frozen=True)
class Crop:
    """A square: its centre and side in pixels, and its angle (radians, clockwise in the picture).

    A point of the crop is given in shares of its side, (0, 0) its upper left corner.
    """

    x: float
    y: float
    side: float
    angle: float

    @property
    def axes(self) -> np.ndarray:
        """(2, 2), columns: the crop's sides in the picture."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return self.side * np.array([[cos, -sin], [sin, cos]])

    def in_picture(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 2) of the crop in pixels of the picture."""
        return np.array([self.x, self.y]) + (points - 0.5) @ self.axes.T


def whole(height: int, width: int) -> Crop:
    """The smallest upright square that has the whole picture in it, about its centre."""
    return Crop(width / 2, height / 2, float(max(height, width)), 0.0)


def about(centre: np.ndarray, rim: np.ndarray) -> Crop:
    """The crop of a body: `centre` (2,) between its hips, `rim` (2,) on the circle about the whole
    body, in the direction of its head."""
    dx, dy = rim - centre
    side = 2 * MARGIN * math.hypot(dx, dy)
    return Crop(float(centre[0]), float(centre[1]), side, math.atan2(dy, dx) + math.pi / 2)


def upright_about(corners: np.ndarray) -> Crop:
    """The upright crop about a box: its corners (2, 2) in pixels."""
    x, y = corners.mean(axis=0)
    return Crop(float(x), float(y), MARGIN * float((corners[1] - corners[0]).max()), 0.0)


def is_same(a: Crop, b: Crop) -> bool:
    """Whether two crops show the same body in nearly the same way."""
    near = math.hypot(a.x - b.x, a.y - b.y) < SAME_PLACE * max(a.side, b.side)
    turned = abs(math.remainder(a.angle - b.angle, 2 * math.pi))
    ratio = max(a.side, b.side) / max(min(a.side, b.side), 1e-9)
    return near and ratio < SAME_SIDE and turned < SAME_ANGLE


def pixels(picture: Pyramid, crop: Crop, size: int) -> Any:
    """The crop's pixels, (size, size, 3), black outside the picture; reduced by area, so that
    fine patterns do not become coarse ones."""
    times = _halvings(picture, crop, size)
    share = 0.5**times
    fine = size * max(1, round(share * crop.side / size))
    axes = share * crop.axes / fine
    middle = share * np.array([crop.x, crop.y]) - axes @ np.full(2, fine / 2)
    first = middle + axes @ np.full(2, 0.5) - 0.5  # cv2 counts from the first pixel's centre
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    matrix = np.column_stack([axes, first])
    cut = cv2.warpAffine(picture.halved(times), matrix, (fine, fine), flags=flags)
    return cut if fine == size else cv2.resize(cut, (size, size), interpolation=cv2.INTER_AREA)


def _halvings(picture: Pyramid, crop: Crop, size: int) -> int:
    """How often a picture can be halved until a crop has hardly more than the asked pixels."""
    most = math.log2(max(min(picture.shape[:2]), 1))
    return max(0, int(min(math.log2(max(crop.side / size, 1)), most)))
