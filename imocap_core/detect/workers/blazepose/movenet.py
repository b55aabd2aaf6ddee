"""MoveNet, a second network that looks at a body: 17 points in one crop.

Its outputs are those of a CenterNet: heat of the body's middle, from there a first place of each
point, heat of each point near it, and what the place is off the middle of the heat's cell.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from .crops import MARGIN, Crop, pixels
from .landmarks import Landmarks
from .networks import Network, sigmoid
from .pyramid import Pyramid

SIZE = 256  # pixels of the network's input
OUTPUTS = ("kpt_heatmap", "center", "kpt_regress", "kpt_offset")  # of its graph
POINTS = [0, 2, 5, 7, 8, 11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28]  # among BlazePose's
SOFT = 1.8  # cells: heat counts inversely to its distance and this
PEAKS, LEAST_HEAT = 4, 0.03  # of each point
APART = 5  # cells within which there is one peak


def detect_points(picture: Pyramid, crop: Crop, network: Network) -> np.ndarray:
    """Pixels (17, 2) of the points of the body in the middle of a crop of a picture (H, W, 3),
    RGB; `POINTS` tells which of BlazePose's they are."""
    return points_of(seen_in(picture, crop, network), crop)


def seen_in(picture: Pyramid, crop: Crop, network: Network) -> list[np.ndarray]:
    """The network's `OUTPUTS` for a crop of a picture."""
    return network(pixels(picture, crop, SIZE).astype(np.float32) / 127.5 - 1)


def points_of(outputs: list[np.ndarray], crop: Crop) -> np.ndarray:
    """Pixels (17, 2) of the points of the body in the middle of the crop."""
    heat, centre, first, offset = outputs
    rows, columns, count = heat.shape
    y, x = np.mgrid[:rows, :columns].astype(float)
    middle = sigmoid(centre[..., 0]) / (np.hypot(y - rows / 2, x - columns / 2) + SOFT)
    row, column = np.unravel_index(np.argmax(middle), middle.shape)
    near = first[row, column].reshape(count, 2).astype(float) + (row, column)
    away = np.hypot(y[..., None] - near[:, 0], x[..., None] - near[:, 1])
    best = (sigmoid(heat) / (away + SOFT)).reshape(-1, count).argmax(axis=0)
    cells = np.stack(np.unravel_index(best, (rows, columns)), axis=1)
    return _in_picture(cells, np.arange(count), offset, crop)


def peaks_of(outputs: list[np.ndarray], crop: Crop) -> list[np.ndarray]:
    """Of each of the 17 points, pixels (P, 2) of the places of its highest heat, of any body in the
    crop, the highest first."""
    heat, offset = sigmoid(outputs[0]).astype(np.float32), outputs[3]
    summit = heat >= cv2.dilate(heat, np.ones((APART, APART), np.uint8))
    places = []
    for k in range(heat.shape[2]):
        cells = np.argwhere(summit[..., k] & (heat[..., k] > LEAST_HEAT))
        order = np.argsort(-heat[cells[:, 0], cells[:, 1], k], kind="stable")[:PEAKS]
        places.append(_in_picture(cells[order], k, offset, crop))
    return places


def _in_picture(cells: np.ndarray, point: np.ndarray | int, offset: np.ndarray, crop: Crop) -> Any:
    """Pixels (N, 2) of a point, or of one each, in cells (N, 2) of the heat."""
    rows, columns = offset.shape[:2]
    off = offset.reshape(rows, columns, -1, 2)[cells[:, 0], cells[:, 1], point]
    return crop.in_picture((cells + off)[:, ::-1] / (columns, rows))


def crop_about(body: Landmarks) -> Crop:
    """The square about a body's points, turned so that its trunk is upright."""
    places = body.xy_px[POINTS]
    hips, shoulders = places[[11, 12]].mean(axis=0), places[[5, 6]].mean(axis=0)
    right, down = shoulders - hips
    angle = float(np.arctan2(down, right)) + np.pi / 2
    upright = Crop(0.0, 0.0, 1.0, angle)
    turned = (places - hips) @ upright.axes
    middle = hips + upright.axes @ (turned.min(axis=0) + turned.max(axis=0)) / 2
    side = MARGIN * float(np.ptp(turned, axis=0).max())
    return Crop(float(middle[0]), float(middle[1]), max(side, 1.0), angle)
