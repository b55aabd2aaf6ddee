"""Person boxes: everybody in a picture, by two networks; duplicates and refused boxes.

Person boxes: everybody in a picture, by an SSD MobileNet v2 trained on Open Images. MediaPipe's
graph `object_detection_oid_v4`: 1917 anchors of six layers, each with the logits of 24 classes and
a box.

BlazePose's person detector: everybody in a picture, by a single-shot network of fixed anchors.
MediaPipe's graph `pose_detection`: 2254 anchors, each with a logit and a box of four points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .landmarks import SIZE as CROP_SIZE
from .landmarks import (
    Crop,
    Landmarks,
    Network,
    Pyramid,
    about,
    mask_in,
    pixels,
    sigmoid,
    upright_about,
    whole,
)

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


PERSON_SIZE = 224  # pixels of the network's input
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
    given = pixels(picture, view, PERSON_SIZE).astype(np.float32) / 127.5 - 1
    values, logits = network(given)
    confidence = sigmoid(logits[:, 0])
    likely = confidence >= least_confidence
    boxes, points = _decode_person(values[likely], anchors()[likely])
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


def _decode_person(values: np.ndarray, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (N, 2, 2), upper left and lower right corner, and points (N, 4, 2) of the values
    (N, 12): centre, size and points, pixels of the input about the anchors."""
    rows = values.astype(float).reshape(-1, 6, 2) / PERSON_SIZE
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


IN_MASK = 0.5
STILL_VISIBLE = 0.1  # share of the visibility that a hidden joint keeps


def with_hidden(bodies: Sequence[Landmarks]) -> list[Landmarks]:
    """The bodies, with less visibility where a joint lies on another's pixels and not its own."""
    return [
        replace(body, visibility=np.where(hidden(body, bodies), STILL_VISIBLE, 1) * body.visibility)
        for body in bodies
    ]


def hidden(body: Landmarks, people: Sequence[Landmarks]) -> np.ndarray:
    """Which of a body's joints (33,) lie on the pixels of other people, and not on its own."""
    others = [share_there(other, body.xy_px) for other in people if other is not body]
    if not others:
        return np.zeros(len(body.xy_px), bool)
    covered = np.max(others, axis=0) > IN_MASK
    return np.asarray(covered & (share_there(body, body.xy_px) < IN_MASK))


def share_there(body: Landmarks, points: np.ndarray) -> np.ndarray:
    """A body's mask at points (N, 2) of the picture, 0 outside its crop."""
    crop = body.crop
    cells = np.linalg.solve(crop.axes, (points - (crop.x, crop.y)).T).T + 0.5
    columns, rows = np.floor(cells * CROP_SIZE).astype(int).T
    inside = (columns >= 0) & (columns < CROP_SIZE) & (rows >= 0) & (rows < CROP_SIZE)
    share = body.mask[rows.clip(0, CROP_SIZE - 1), columns.clip(0, CROP_SIZE - 1)]
    return np.asarray(np.where(inside, share, 0.0))


LIMBS = [11, 13, 15, 23, 25, 27, 12, 14, 16, 24, 26, 28]  # left, then right
OTHER_SIDE = np.roll(np.arange(12), 6)
SAME_JOINT = 0.07  # of the body's size: so near lie a joint of one person, detected twice
ONE_PERSON_OVERLAP = 0.5  # share of joints, or of pixels, of two answers about one person
CELLS = 16  # a side of the grid of points in the box of a body
IN_THE_WAY = 0.03  # share of the box that another person covers


def quality(body: Landmarks) -> float:
    """How well a body is seen: the probability of a person, times the mean visibility."""
    return body.presence * float(body.visibility.mean())


def distinct(bodies: Sequence[Landmarks], ranks: Sequence[int]) -> list[int]:
    """Rows of the bodies that are different people: those of the lowest rank first, of one rank the
    best seen.

    A body with half its joints where those of people before it are is none: it is one of them, or
    put together of several.
    """
    rows: list[int] = []
    for row in sorted(range(len(bodies)), key=lambda row: (ranks[row], -quality(bodies[row]))):
        if not is_duplicate(bodies[row], [bodies[other] for other in rows]):
            rows.append(row)
    return rows


def is_duplicate(body: Landmarks, others: Sequence[Landmarks]) -> bool:
    """Whether half of a body's joints are those of others, or of the pixels of both masks."""
    if shared(body, others) >= ONE_PERSON_OVERLAP:
        return True
    return any(mask_overlap(body, other) >= ONE_PERSON_OVERLAP for other in others)


def mask_overlap(a: Landmarks, b: Landmarks) -> float:
    """Intersection over union of the masks of two bodies, in the crop of the first."""
    one, other = a.mask > IN_MASK, mask_in(a.crop, b) > IN_MASK
    union = int((one | other).sum())
    return float((one & other).sum()) / union if union else 0.0


def shared(body: Landmarks, others: Sequence[Landmarks]) -> float:
    """Share of a body's joints that are joints of others; their sides may be exchanged."""
    taken = np.zeros(len(LIMBS), bool)
    for other in others:
        limit = SAME_JOINT * min(size_of(body), size_of(other))
        places, others_places = body.xy_px[LIMBS], other.xy_px[LIMBS]
        near = [
            np.linalg.norm(places - rows, axis=1) < limit
            for rows in (others_places, others_places[OTHER_SIDE])
        ]
        taken |= max(near, key=lambda joints: int(joints.sum()))
    return float(taken.mean())


def is_in_the_way(other: Landmarks, body: Landmarks) -> bool:
    """Whether another person's pixels are in the box of a body, or its joints are the other's."""
    (x0, y0), (x1, y1) = corners_of(body)
    x, y = np.linspace(x0, x1, CELLS), np.linspace(y0, y1, CELLS)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    covered = float((share_there(other, grid) > IN_MASK).mean())
    return covered > IN_THE_WAY or shared(body, [other]) >= IN_THE_WAY


def in_front_first(bodies: Sequence[Landmarks], steps: Sequence[float]) -> list[int]:
    """Rows of the bodies: the best seen first, but of several answers about one person first the
    one that moved least (`steps`), because the others are about somebody else."""
    copies = [
        sum(
            steps[other] < steps[row] and is_duplicate(bodies[row], [bodies[other]])
            for other in range(len(bodies))
            if other != row
        )
        for row in range(len(bodies))
    ]
    return sorted(range(len(bodies)), key=lambda row: (copies[row], -quality(bodies[row])))


def step(body: Landmarks, last: Landmarks) -> float:
    """How far the joints moved from one frame to the next: the median, in sizes of the body."""
    moved = np.linalg.norm(body.xy_px[LIMBS] - last.xy_px[LIMBS], axis=1)
    return float(np.median(moved)) / size_of(last)


def size_of(body: Landmarks) -> float:
    """Diagonal of the box of a body's joints in pixels, at least 1."""
    return max(1.0, float(np.hypot(*np.ptp(body.xy_px, axis=0))))


def corners_of(body: Landmarks) -> np.ndarray:
    """Corners (2, 2) of the box of a body's joints."""
    return np.stack([body.xy_px.min(axis=0), body.xy_px.max(axis=0)])


PATIENCE = 30  # frames
SAME_BOX = 0.5  # intersection over union


class RefusedBoxes:
    """Boxes with nobody new in them, and when that was found."""

    def __init__(self) -> None:
        self._boxes: list[tuple[int, PersonBox]] = []

    def add(self, frame: int, box: PersonBox) -> None:
        """Nobody new is in a box of this frame."""
        self._boxes = [(t, other) for t, other in self._boxes if frame - t < PATIENCE]
        self._boxes.append((frame, box))

    def has(self, frame: int, box: PersonBox) -> bool:
        """Whether nobody new was in a box a short time before this frame."""
        return any(
            frame - t < PATIENCE and overlap(box.corners, other.corners) > SAME_BOX
            for t, other in self._boxes
        )

    def forget(self) -> None:
        """Somebody was lost, and may be in any of them."""
        self._boxes = []
