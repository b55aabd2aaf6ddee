"""BlazePose's person detector: everybody in a picture, by a single-shot network of fixed anchors.

MediaPipe's graph `pose_detection`: 2254 anchors, each with a logit and a box of four points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .boxes import overlap
from .crops import Crop, about, pixels, whole
from .networks import Network, sigmoid
from .pyramid import Pyramid

SIZE = 224  # pixels of the network's input
LAYERS = ((28, 2), (14, 2), (7, 6))  # cells a side, anchors a cell
ONE_PERSON = 0.3  # intersection over union of boxes of one person


@dataclass(frozen=True)
class DetectedPerson:
    """A detected person: the confidence, and the crop about the whole body."""

    confidence: float
    crop: Crop


def detect_people(
    picture: Pyramid, network: Network, least_confidence: float
) -> list[DetectedPerson]:
    """Everybody in a picture (H, W, 3), RGB, the most confident first."""
    height, width = picture.shape[:2]
    view = whole(height, width)
    given = pixels(picture, view, SIZE).astype(np.float32) / 127.5 - 1
    values, logits = network(given)
    confidence = sigmoid(logits[:, 0])
    likely = confidence >= least_confidence
    boxes, points = _decode(values[likely], anchors()[likely])
    people = []
    for best, share in _groups(boxes, confidence[likely]):
        centre, rim = view.in_picture(np.tensordot(share, points, 1))[:2]
        people.append(DetectedPerson(float(confidence[likely][best]), about(centre, rim)))
    return people


def anchors() -> np.ndarray:
    """Centres (2254, 2) of the anchors, shares of the picture's sides."""
    layers = []
    for cells, count in LAYERS:
        centres = (np.arange(cells) + 0.5) / cells
        y, x = np.meshgrid(centres, centres, indexing="ij")
        layers.append(np.repeat(np.stack([x, y], axis=-1).reshape(-1, 2), count, axis=0))
    return np.concatenate(layers)


def _decode(values: np.ndarray, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (N, 2, 2), upper left and lower right corner, and points (N, 4, 2) of the values
    (N, 12): centre, size and points, pixels of the input about the anchors."""
    rows = values.astype(float).reshape(-1, 6, 2) / SIZE
    middle, half = rows[:, 0] + centres, rows[:, 1] / 2
    return np.stack([middle - half, middle + half], axis=1), rows[:, 2:] + centres[:, None]


def _groups(boxes: np.ndarray, confidence: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Weighted non-maximum suppression: of each person the most confident box, and the shares (N,)
    of all boxes in it."""
    groups = []
    waiting = list(np.argsort(-confidence, kind="stable"))
    while waiting:
        best = waiting[0]
        near = [k for k in waiting if k == best or overlap(boxes[best], boxes[k]) > ONE_PERSON]
        share = np.zeros(len(boxes))
        share[near] = confidence[near] / confidence[near].sum()
        groups.append((int(best), share))
        waiting = [k for k in waiting if k not in near]
    return groups
