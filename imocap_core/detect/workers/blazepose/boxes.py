"""Person boxes: everybody in a picture, by an SSD MobileNet v2 trained on Open Images.

MediaPipe's graph `object_detection_oid_v4`: 1917 anchors of six layers, each with the logits of 24
classes and a box.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .crops import Crop, pixels, upright_about, whole
from .networks import Network, sigmoid
from .pyramid import Pyramid

SIZE = 300  # pixels of the network's input
STRIDES = (16, 32, 64, 128, 256, 512)  # pixels of the input a cell
SMALLEST, LARGEST = 0.2, 0.95  # sides of the anchors of the first and the last layer
FINEST = 0.1  # the smallest anchor of the first layer
RATIOS = (1.0, 2.0, 0.5, 3.0, 1 / 3)  # width / height
PERSON = 4  # of the classes
CENTRE_SCALE, SIDE_SCALE = 10.0, 5.0
ONE_BOX = 0.5  # intersection over union of boxes of one person


@dataclass(frozen=True)
class PersonBox:
    """A detected person: the confidence, and the corners (2, 2) in pixels of the picture."""

    confidence: float
    corners: np.ndarray

    @property
    def crop(self) -> Crop:
        """The upright crop about the box."""
        return upright_about(self.corners)


def detect_boxes(picture: Pyramid, network: Network, least_confidence: float) -> list[PersonBox]:
    """Everybody in a picture (H, W, 3), RGB, the most confident first."""
    height, width = picture.shape[:2]
    view = whole(height, width)
    values, logits = network(pixels(picture, view, SIZE).astype(np.float32) / 127.5 - 1)
    confidence = sigmoid(logits[:, PERSON])
    likely = confidence >= least_confidence
    corners, confidence = _decode(values[likely], box_anchors()[likely]), confidence[likely]
    distinct: list[int] = []
    for k in np.argsort(-confidence, kind="stable"):
        if all(overlap(corners[k], corners[other]) < ONE_BOX for other in distinct):
            distinct.append(int(k))
    return [PersonBox(float(confidence[k]), view.in_picture(corners[k])) for k in distinct]


def box_anchors() -> np.ndarray:
    """Anchors (1917, 4): centre x, y, width, height, shares of the input's side."""
    step = (LARGEST - SMALLEST) / (len(STRIDES) - 1)
    sides = [SMALLEST + step * layer for layer in range(len(STRIDES))] + [1.0]
    rows = []
    for layer, stride in enumerate(STRIDES):
        if layer == 0:
            shapes = [(FINEST, FINEST), *(_shape(SMALLEST, ratio) for ratio in RATIOS[1:3])]
        else:
            between = math.sqrt(sides[layer] * sides[layer + 1])
            shapes = [*(_shape(sides[layer], ratio) for ratio in RATIOS), (between, between)]
        cells = math.ceil(SIZE / stride)
        centres = (np.arange(cells) + 0.5) / cells
        y, x = np.meshgrid(centres, centres, indexing="ij")
        places = np.repeat(np.stack([x, y], axis=-1).reshape(-1, 2), len(shapes), axis=0)
        rows.append(np.column_stack([places, np.tile(shapes, (cells * cells, 1))]))
    return np.concatenate(rows)


def _shape(side: float, ratio: float) -> tuple[float, float]:
    """Width and height of an anchor with the area of a square."""
    return side * math.sqrt(ratio), side / math.sqrt(ratio)


def _decode(values: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    """Corners (N, 2, 2), shares of the input's side, of values (N, 4): y, x, height, width."""
    offsets = values.astype(float)[:, [1, 0, 3, 2]]
    centre = offsets[:, :2] / CENTRE_SCALE * anchors[:, 2:] + anchors[:, :2]
    half = np.exp(offsets[:, 2:] / SIDE_SCALE) * anchors[:, 2:] / 2
    return np.stack([centre - half, centre + half], axis=1)


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of two boxes (2, 2), upper left and lower right corners."""
    common = np.clip(np.minimum(a[1], b[1]) - np.maximum(a[0], b[0]), 0, None).prod()
    total = (a[1] - a[0]).prod() + (b[1] - b[0]).prod() - common
    return float(common / total) if total > 0 else 0.0
