"""BlazePose's landmark network: 33 points of the body and two of its circle in one crop.

MediaPipe's graph `pose_landmark_by_roi`: points from a regression, each refined by its heatmap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .crops import Crop, about, pixels
from .person import Network, sigmoid

SIZE = 256  # pixels of the network's input
POINTS, BODY = 39, 33
CENTRE, RIM = 33, 34  # between the hips; on the circle about the whole body, beyond the head
REACH = 3  # cells of the heatmap about a point
LEAST_HEAT = 0.5


@dataclass(frozen=True)
class Landmarks:
    """The landmarks of one person.

    xy_px: (33, 2) pixels of the picture. z_px: (33,) towards the camera negative, from the middle
    of the hips. visibility: (33,). world_m: (33, 3) metres from the middle of the hips. presence:
    probability of a person in the crop. next_crop: about these landmarks.
    """

    xy_px: np.ndarray
    z_px: np.ndarray
    visibility: np.ndarray
    world_m: np.ndarray
    presence: float
    next_crop: Crop


def detect_landmarks(picture: np.ndarray, crop: Crop, network: Network) -> Landmarks:
    """The body in a crop of a picture (H, W, 3), RGB."""
    given = pixels(picture, crop, SIZE).astype(np.float32) / 255
    values, presence, _, heat, world = network(given)
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
    )


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
