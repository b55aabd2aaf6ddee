"""MoveNet, a second network that looks at a body, and the limbs as both networks have them.

Its outputs are those of a CenterNet: heat of the body's middle, from there a first place of each
point, heat of each point near it, and what the place is off the middle of the heat's cell.

Limbs as two networks tell them: their mean, and less visibility where they disagree. The two are
trained apart and err apart, where one network's answers to the same picture, mirrored or cropped
otherwise, err together.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from .landmarks import MARGIN, Crop, Landmarks, Network, Pyramid, pixels, sigmoid

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


ARMS, LEGS = [0, 1, 4, 5], [2, 3, 6, 7]  # among the joints below
JOINTS = [13, 15, 25, 27, 14, 16, 26, 28]  # elbow, wrist, knee, ankle: left, then right
SECOND_POINTS = [POINTS.index(joint) for joint in JOINTS]  # among the second network's
TIPS = {15: (17, 19, 21), 16: (18, 20, 22), 27: (29, 31), 28: (30, 32)}  # that go with a joint
# Shares of a body's size:
NEAR = 0.05  # distance within which the mean of both counts; beyond, the first network's place
DOUBTFUL = 0.08  # distance that halves the visibility
ELSEWHERE = 0.02  # median distance beyond which one of the two may look at a wrong place
SOMEBODY_ELSE = 0.15  # and beyond which the second network has another body
SWAPPED, NETWORKS_APART = 0.6, 0.03  # of the distance, with sides exchanged; joints' mean distance


def is_doubted(body: Landmarks) -> bool:
    """Whether a second network has most limb joints elsewhere, or was not asked."""
    return body.second_xy_px is None or float(np.median(_distances(body)[1])) > ELSEWHERE


def combined(body: Landmarks) -> Landmarks:
    """The body, its limbs as both networks tell them."""
    if body.second_xy_px is None:
        return body
    second, away = _distances(body)
    if np.median(away) > SOMEBODY_ELSE:
        return body
    xy, visibility = body.xy_px.copy(), body.visibility.copy()
    share = 0.5 / (1 + (away / NEAR) ** 4)
    xy[JOINTS] += share[:, None] * (second - xy[JOINTS])
    for joint, trust in zip(JOINTS, 1 / (1 + (away / DOUBTFUL) ** 2), strict=True):
        visibility[[joint, *TIPS.get(joint, ())]] *= trust
    return replace(body, xy_px=xy, visibility=visibility)


def _distances(body: Landmarks) -> tuple[np.ndarray, np.ndarray]:
    """The second network's joints (8, 2), and how far they are from the body's, in its sizes."""
    assert body.second_xy_px is not None
    size, first = body.next_crop.side / MARGIN, body.xy_px[JOINTS]
    second = on_the_same_sides(first, body.second_xy_px[SECOND_POINTS], size)
    return second, np.linalg.norm(first - second, axis=1) / size


def on_the_same_sides(first: np.ndarray, second: np.ndarray, size: float) -> np.ndarray:
    """Joints (8, 2) of the second network, arms or legs with left and right exchanged where they
    are much nearer to the first's so: which side is which is judged later, over time."""
    sided = second.copy()
    for limb in (ARMS, LEGS):
        other_side = limb[2:] + limb[:2]
        away = np.linalg.norm(first[limb] - second[limb], axis=1).mean()
        exchanged = np.linalg.norm(first[limb] - second[other_side], axis=1).mean()
        if away > NETWORKS_APART * size and exchanged < SWAPPED * away:
            sided[limb] = second[other_side]
    return sided
