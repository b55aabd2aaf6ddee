"""One person through a video: where each picture is looked at.

The next crop follows from the last landmarks. The person detector looks at the whole picture too:
where its crop is another one, both are tried and the better answer is taken.
"""

from __future__ import annotations

import math

import numpy as np

from .crops import Crop
from .landmarks import Landmarks, detect_landmarks
from .person import Network, detect_people

SAME_PLACE = 0.15  # of the side
SAME_SIDE = 1.25
SAME_ANGLE = math.radians(25)


class Course:
    """The course of one person: pictures in order in, landmarks out."""

    def __init__(
        self, person: Network, landmarks: Network, least_person: float, least_presence: float
    ) -> None:
        self._person, self._landmarks = person, landmarks
        self._least_person, self._least_presence = least_person, least_presence
        self._crop: Crop | None = None

    def next_body(self, picture: np.ndarray) -> Landmarks | None:
        """The body in the next picture (H, W, 3), RGB; None where nobody is detected."""
        crops = [self._crop] if self._crop else []
        people = detect_people(picture, self._person, self._least_person)
        if people and not any(is_same(people[0].crop, crop) for crop in crops):
            crops.append(people[0].crop)
        bodies = [detect_landmarks(picture, crop, self._landmarks) for crop in crops]
        best = max(bodies, key=quality, default=None)
        if best is None or best.presence < self._least_presence:
            self._crop = None
            return None
        self._crop = best.next_crop
        return best


def is_same(a: Crop, b: Crop) -> bool:
    """Whether two crops show the same body in nearly the same way."""
    near = math.hypot(a.x - b.x, a.y - b.y) < SAME_PLACE * max(a.side, b.side)
    turned = abs(math.remainder(a.angle - b.angle, 2 * math.pi))
    ratio = max(a.side, b.side) / max(min(a.side, b.side), 1e-9)
    return near and ratio < SAME_SIDE and turned < SAME_ANGLE


def quality(body: Landmarks) -> float:
    """How well a body is seen: the probability of a person, times the mean visibility."""
    return body.presence * float(body.visibility.mean())
