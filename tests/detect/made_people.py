"""Pictures of people as bars, and networks that find bars: the stand-ins for BlazePose's."""

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from imocap_core.detect.workers.blazepose.boxes import CENTRE_SCALE, PERSON, SIDE_SCALE, box_anchors
from imocap_core.detect.workers.blazepose.boxes import anchors as person_anchors
from imocap_core.detect.workers.blazepose.landmarks import CENTRE, MARGIN, POINTS, RIM

Network = Callable[[np.ndarray], list[np.ndarray]]
SIZE = (400, 600)  # height, width of the pictures
WIDTH, HEIGHT = 40, 120  # of a person
COLD = np.full((64, 64, POINTS), -10.0, np.float32)


def picture(*people: tuple[float, float]) -> np.ndarray:
    """People standing at x, y (their middles, pixels), at most three, each of one colour; the
    first is the nearest."""
    made = np.zeros((*SIZE, 3), np.uint8)
    for n, (x, y) in reversed(list(enumerate(people))):
        corners = [(int(x) - WIDTH // 2, int(y) - HEIGHT // 2)]
        corners.append((corners[0][0] + WIDTH - 1, corners[0][1] + HEIGHT - 1))
        cv2.rectangle(made, corners[0], corners[1], [200 * (n == k) for k in range(3)], -1)
    return made


def bars(pixels: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Boxes (x, y, width, height) and pixels of the bars in a picture, 0 to 1: one a colour."""
    found = []
    for n in range(3):
        others = np.maximum(pixels[..., n - 1], pixels[..., n - 2])
        mask = ((pixels[..., n] > 0.5) & (others < 0.2)).astype(np.uint8)
        if not mask.any():
            continue
        _, labels, rows, _ = cv2.connectedComponentsWithStats(mask)
        found += [
            (row[:4], labels == label)
            for label, row in enumerate(rows)
            if label and row[4] > 60 and min(row[2:4]) > 3
        ]
    return found


def box_network(confidence: Sequence[float] = (0.9,)) -> Network:
    """Finds every bar by two anchors; with a confidence for each."""

    def network(given: np.ndarray) -> list[np.ndarray]:
        assert given.shape == (300, 300, 3)
        assert given.min() >= -1
        anchors = box_anchors()
        values, logits = np.zeros((1917, 4), np.float32), np.full((1917, 24), -9.0, np.float32)
        for n, ((x, y, width, height), _) in enumerate(bars((given + 1) / 2)):
            centre = np.array([x + width / 2, y + height / 2]) / 300
            for k in np.argsort(np.linalg.norm(anchors[:, :2] - centre, axis=1))[:2]:
                offset = (centre - anchors[k, :2]) / anchors[k, 2:] * CENTRE_SCALE
                side = np.log(np.array([width, height]) / 300 / anchors[k, 2:]) * SIDE_SCALE
                values[k] = [offset[1], offset[0], side[1], side[0]]
                share = confidence[min(n, len(confidence) - 1)]
                logits[k, PERSON] = np.log(share / (1 - share))
        return [values, logits]

    return network


def blind_network(given: np.ndarray) -> list[np.ndarray]:
    """Finds nobody."""
    return [np.zeros((1917, 4), np.float32), np.full((1917, 24), -9.0, np.float32)]


def landmark_network(given: np.ndarray) -> list[np.ndarray]:
    """Finds the largest bar that is near the middle of the crop; all its joints lie on it."""
    assert given.shape == (256, 256, 3)
    near = [
        (mask.sum(), n, mask, (x, y, width, height))
        for n, ((x, y, width, height), mask) in enumerate(bars(given))
        if np.hypot(x + width / 2 - 128, y + height / 2 - 128) < 90
    ]
    rows, mask = np.zeros((POINTS, 5), np.float32), np.full((256, 256), -9.0, np.float32)
    if near:
        *_, pixels, (x, y, width, height) = max(near, key=lambda bar: bar[:2])
        rows[:, 0] = x + width * (0.1 + 0.8 * (np.arange(POINTS) % 2))
        rows[:, 1] = y + height * np.arange(POINTS) / (POINTS - 7)
        rows[CENTRE, :2] = x + width / 2, y + height / 2
        rows[RIM, :2] = rows[CENTRE, :2] - (0, 0.5 * height / MARGIN * 1.3)
        mask[pixels] = 9.0
    rows[:, 3] = 5.0
    presence = np.float32([1.0 if near else 0.0])
    return [rows.ravel(), presence, mask[..., None], COLD, np.zeros(3 * POINTS, np.float32)]


def blind_person_detector(given: np.ndarray) -> list[np.ndarray]:
    """BlazePose's own detector, which finds nobody."""
    return [np.zeros((2254, 12), np.float32), np.full((2254, 1), -9.0, np.float32)]


def person_detector(given: np.ndarray) -> list[np.ndarray]:
    """BlazePose's own detector, which finds every bar, upright."""
    anchors = person_anchors()
    values, logits = blind_person_detector(given)
    for (x, y, width, height), _ in bars((given + 1) / 2):
        middle = np.array([x + width / 2, y + height / 2])
        anchor = np.linalg.norm(anchors - middle / 224, axis=1).argmin()
        dx, dy = middle - 224 * anchors[anchor]
        rim = dy - 0.5 * height / MARGIN * 1.3
        values[anchor] = [dx, dy, width, height, dx, dy, dx, rim, dx, dy, dx, dy]
        logits[anchor] = 4.0
    return [values, logits]


def drifting_network(given: np.ndarray) -> list[np.ndarray]:
    """As `landmark_network`, but what is off the middle of the crop is answered nearer to it, and
    seen less well: crops that follow such answers stay behind."""
    rows, presence, mask, heat, world = landmark_network(given)
    points = rows.reshape(POINTS, 5)
    away = points[CENTRE, :2] - 128
    if presence[0]:
        points[:, :2] -= 0.8 * away
        points[:, 3] -= np.hypot(*away) / 10
    return [rows, presence, mask, heat, world]
