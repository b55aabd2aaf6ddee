"""BlazePose's landmark network: 33 points of the body and two of its circle in one crop.

Square crops about a person: where they lie in the picture, and their pixels. A crop turns with the
person, so that the networks get an upright body. Positions are pixels of the picture; a pixel
covers the square from its number to the next.

A picture, and itself at half the size, as often as its crops ask for (an image pyramid).
MediaPipe's graph `pose_landmark_by_roi`: points from a regression, each refined by its heatmap.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

LARGEST_LOGIT = 100.0
Network = Callable[[np.ndarray], list[np.ndarray]]  # outputs of a float32 picture (size, size, 3)


def sigmoid(logits: np.ndarray) -> np.ndarray:
    """Probabilities of logits."""
    clipped = np.clip(logits.astype(float), -LARGEST_LOGIT, LARGEST_LOGIT)
    return np.asarray(1 / (1 + np.exp(-clipped)))


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
    # halved until the crop has hardly more than the asked pixels
    most = math.log2(max(min(picture.shape[:2]), 1))
    times = max(0, int(min(math.log2(max(crop.side / size, 1)), most)))
    share = 0.5**times
    fine = size * max(1, round(share * crop.side / size))
    axes = share * crop.axes / fine
    middle = share * np.array([crop.x, crop.y]) - axes @ np.full(2, fine / 2)
    first = middle + axes @ np.full(2, 0.5) - 0.5  # cv2 counts from the first pixel's centre
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    matrix = np.column_stack([axes, first])
    cut = cv2.warpAffine(picture.halved(times), matrix, (fine, fine), flags=flags)
    return cut if fine == size else cv2.resize(cut, (size, size), interpolation=cv2.INTER_AREA)


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


SIZE = 256  # pixels of the network's input
POINTS, BODY = 39, 33
CENTRE, RIM = 33, 34  # between the hips; on the circle about the whole body, beyond the head
REACH = 3  # cells of the heatmap about a point
LEAST_HEAT = 0.5
GROWN, SPREAD = 9, 12.0  # pixels: of another person's mask, and of the colours that fill it


@dataclass(frozen=True)
class Landmarks:
    """The landmarks of one person.

    xy_px: (33, 2) pixels of the picture. z_px: (33,) towards the camera negative, from the middle
    of the hips. visibility: (33,). world_m: (33, 3) metres from the middle of the hips. presence:
    probability of a person in the crop. next_crop: about these landmarks. mask: (256, 256) share
    of the person in the pixels of `crop`. second_xy_px: (17, 2), a second network's points.
    """

    xy_px: np.ndarray
    z_px: np.ndarray
    visibility: np.ndarray
    world_m: np.ndarray
    presence: float
    next_crop: Crop
    crop: Crop
    mask: np.ndarray
    second_xy_px: np.ndarray | None = None


def detect_landmarks(
    picture: Pyramid, crop: Crop, network: Network, others: Sequence[Landmarks] = ()
) -> Landmarks:
    """The body in a crop of a picture (H, W, 3), RGB, with other people painted over."""
    given = pixels(picture, crop, SIZE).astype(np.float32) / 255
    for other in others:
        given = painted_over(given, crop, other)
    values, presence, mask, heat, world = network(given)
    rows = values.astype(float).reshape(POINTS, 5)
    xy = crop.in_picture(refined(rows[:, :2] / SIZE, heat))
    turn = crop.axes / crop.side
    metres = world.astype(float).reshape(POINTS, 3)[:BODY]
    return Landmarks(
        xy_px=xy[:BODY],
        z_px=rows[:BODY, 2] / SIZE * crop.side,
        visibility=sigmoid(rows[:BODY, 3]),
        world_m=np.column_stack([metres[:, :2] @ turn.T, metres[:, 2]]),
        presence=float(presence[0]),
        next_crop=about(xy[CENTRE], xy[RIM]),
        crop=crop,
        mask=sigmoid(mask.reshape(SIZE, SIZE)).astype(np.float32),
    )


def mask_in(crop: Crop, body: Landmarks) -> np.ndarray:
    """A body's mask (256, 256) in another crop's pixels."""
    axes = np.linalg.solve(body.crop.axes, crop.axes)
    origin = np.zeros(2)
    corner = np.linalg.solve(body.crop.axes, crop.in_picture(origin) - body.crop.in_picture(origin))
    first = corner * SIZE + axes @ np.full(2, 0.5) - 0.5
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(body.mask, np.column_stack([axes, first]), (SIZE, SIZE), flags=flags)
    )


def painted_over(pixels_in_crop: np.ndarray, crop: Crop, other: Landmarks) -> np.ndarray:
    """A crop's pixels (256, 256, 3) with another person's filled with the colours
    around them."""
    hole = cv2.dilate(mask_in(crop, other), np.ones((GROWN, GROWN), np.uint8))
    rest = (1 - hole)[..., None]
    colours = np.concatenate([pixels_in_crop * rest, rest + 1e-6], axis=2)
    spread = cv2.GaussianBlur(colours, (0, 0), SPREAD)
    fill = spread[..., :3] / spread[..., 3:]
    return np.asarray(pixels_in_crop * rest + fill * (1 - rest), np.float32)


def refined(points: np.ndarray, heat: np.ndarray) -> np.ndarray:
    """Points (K, 2), shares of the crop, moved to the centre of heat near them (heat: logits, rows,
    columns, K); a point without heat stays."""
    rows, columns = heat.shape[:2]
    moved = points.copy()
    for k, (x, y) in enumerate(points * (columns, rows)):
        if not (0 <= x < columns and 0 <= y < rows):
            continue
        left, top = max(0, int(x) - REACH), max(0, int(y) - REACH)
        near = sigmoid(heat[top : int(y) + REACH + 1, left : int(x) + REACH + 1, k])
        if near.max() > LEAST_HEAT:
            mean_x = near.sum(axis=0) @ (left + np.arange(near.shape[1])) / near.sum()
            mean_y = near.sum(axis=1) @ (top + np.arange(near.shape[0])) / near.sum()
            moved[k] = mean_x / columns, mean_y / rows
    return moved
