"""BlazePose's landmark network: 33 points of the body and two of its circle in one crop.

MediaPipe's graph `pose_landmark_by_roi`: points from a regression, each refined by its heatmap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from .crops import Crop, about, pixels
from .networks import Network, sigmoid
from .pyramid import Pyramid

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
