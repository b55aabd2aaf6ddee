"""Everybody through a video: where each picture is looked at.

Each person's next crop follows from the last landmarks. The person detector looks at the whole
picture every few frames and whenever somebody was lost; a box in which nobody is followed is a new
person, who is also followed backward through the last pictures.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .boxes import PersonBox, detect_boxes, overlap
from .crops import Crop, is_same
from .hidden import with_hidden
from .landmarks import Landmarks, detect_landmarks
from .networks import Network
from .overlap import (
    corners_of,
    distinct,
    in_front_first,
    is_duplicate,
    is_in_the_way,
    quality,
    shared,
    size_of,
    step,
)
from .person import detect_people

EVERY = 5  # frames from one look at the whole picture to the next
FOLLOWED = 0.5  # intersection over union of the box of a person who is followed and the detector's
CONTESTED = 0.25  # share of joints at those of others, beyond which a body is not itself
LEAST_QUALITY = 0.75  # of a body with others painted over, of that without
LEAST_DETECTED = 0.5  # confidence of a person whom BlazePose's detector gives
NEAR = 0.5  # sides of a crop: further away it is somebody else
PREFERRED = 1.3  # of their size: people who are followed already
MOST_BYTES = 200_000_000  # of the last pictures
Earlier = list[tuple[int, Landmarks]]  # so many frames ago


@dataclass(frozen=True)
class FollowedPerson:
    """A followed person: the landmarks now and those of the first frame, `age` frames ago."""

    body: Landmarks
    first: Landmarks
    age: int = 0


class Course:
    """The courses of everybody: pictures in order in, landmarks out."""

    def __init__(
        self,
        boxes: Network,
        person_detector: Network,
        landmarks: Network,
        least_person: float,
        least_presence: float,
        most_people: int,
    ) -> None:
        self._boxes, self._person_detector, self._landmarks = boxes, person_detector, landmarks
        self._least_person, self._least_presence = least_person, least_presence
        self._most_people = most_people
        self._people: list[FollowedPerson] = []
        self._last: deque[tuple[np.ndarray, list[Landmarks]]] = deque()
        self._until_boxes = 0

    def next_people(self, picture: np.ndarray) -> tuple[list[Landmarks], Earlier]:
        """Everybody in the next picture (H, W, 3), RGB, and the people overlooked in the last."""
        followed = self._followed(picture)
        people = merged(followed, [])
        self._until_boxes -= 1
        if self._until_boxes < 0 or not people or len(people) < len(self._people):
            people = merged(followed, self._fresh(picture, [person.body for person in people]))
            self._until_boxes = EVERY - 1
        self._people = largest(people, self._most_people)
        new = [person for person in self._people if person.age == EVERY]
        earlier = [past for person in new for past in self._backward(person)]
        self._remember(picture, [person.body for person in self._people])
        return with_hidden([person.body for person in self._people]), earlier

    def _followed(self, picture: np.ndarray) -> list[FollowedPerson]:
        """The people of the last picture in this one: the best seen first, the others then without
        them, where they are in the way."""
        answers = [(p, self._look(picture, p.body.next_crop)) for p in self._people]
        answers = self._with_detected_crops(picture, answers)
        present = [(p, body) for p, body in answers if body]
        steps = [step(body, p.body) for p, body in present]
        bodies = [body for _, body in present]
        people: list[FollowedPerson] = []
        for row in in_front_first(bodies, steps):
            person, body = present[row]
            others = [other.body for other in people if other.age >= EVERY]
            best = self._apart(picture, person.body.next_crop, body, others)
            people.append(replace(person, body=best, age=person.age + 1))
        return people

    def _with_detected_crops(
        self, picture: np.ndarray, answers: list[tuple[FollowedPerson, Landmarks | None]]
    ) -> list[tuple[FollowedPerson, Landmarks | None]]:
        """The answers, each replaced by a better one in the crop that BlazePose's own detector
        gives the nearest person: it knows how a body is turned, which a drifting one forgets."""
        better = list(answers)
        for detected in (
            detect_people(picture, self._person_detector, LEAST_DETECTED) if answers else []
        ):
            crop = detected.crop
            away = [distance_of(crop, person.body.next_crop) for person, _ in answers]
            row = int(np.argmin(away))
            person, body = better[row]
            if away[row] > NEAR or is_same(crop, person.body.next_crop):
                continue
            fresh = self._look(picture, crop)
            others = [other for k, (_, other) in enumerate(answers) if k != row and other]
            if fresh and shared(fresh, others) < CONTESTED:
                best = max((fresh, body), key=quality) if body else fresh
                better[row] = (person, best)
        return better

    def _look(
        self, picture: np.ndarray, crop: Crop, others: Sequence[Landmarks] = ()
    ) -> Landmarks | None:
        """The body in a crop, None where nobody is."""
        body = detect_landmarks(picture, crop, self._landmarks, others)
        return body if body.presence >= self._least_presence else None

    def _apart(
        self, picture: np.ndarray, crop: Crop, body: Landmarks, others: Sequence[Landmarks]
    ) -> Landmarks:
        """The body in a crop, looked at again with the people painted over who are in its way; as
        it was where that shows less of it, and it had hardly any of their joints."""
        rivals = [other for other in others if is_in_the_way(other, body)]
        again = self._look(picture, crop, rivals) if rivals else None
        if again is None:
            return body
        is_worse = quality(again) < LEAST_QUALITY * quality(body)
        return body if is_worse and shared(body, rivals) < CONTESTED else again

    def _fresh(self, picture: np.ndarray, bodies: Sequence[Landmarks]) -> list[Landmarks]:
        """People in boxes in which nobody is followed, each looked at twice."""
        fresh: list[Landmarks] = []
        for box in detect_boxes(picture, self._boxes, self._least_person)[: self._most_people]:
            if is_followed(box, [*bodies, *fresh]):
                continue
            others = [*bodies, *fresh]
            first = self._look(picture, box.crop)
            if first:
                first = self._apart(picture, box.crop, first, others)
                second = self._look(picture, first.next_crop)
                if second:
                    fresh.append(self._apart(picture, first.next_crop, second, others))
        return fresh

    def _backward(self, person: FollowedPerson) -> Earlier:
        """A person in the last pictures before the first frame, until they are lost or another."""
        earlier: Earlier = []
        body = person.first
        for ago in range(person.age + 1, len(self._last) + 1):
            picture, others = self._last[-ago]
            crop = body.next_crop
            answer = self._look(picture, crop)
            if answer is None or len(others) >= self._most_people:
                break
            body = self._apart(picture, crop, answer, others)
            if is_duplicate(body, others):
                break
            others.append(body)
            earlier.append((ago, with_hidden(others)[-1]))
        return earlier

    def _remember(self, picture: np.ndarray, bodies: list[Landmarks]) -> None:
        """Add a picture to the last ones, as many as there is room for."""
        self._last.append((picture, bodies))
        while len(self._last) > 1 and len(self._last) * picture.nbytes > MOST_BYTES:
            self._last.popleft()


def merged(followed: Sequence[FollowedPerson], fresh: Sequence[Landmarks]) -> list[FollowedPerson]:
    """Different people: who is followed, the best seen first, then who is new."""
    bodies = [person.body for person in followed]
    people = [followed[row] for row in distinct(bodies)]
    for row in distinct(fresh):
        if not is_duplicate(fresh[row], [person.body for person in people]):
            people.append(FollowedPerson(fresh[row], fresh[row]))
    return people


def largest(people: Sequence[FollowedPerson], most_people: int) -> list[FollowedPerson]:
    """At most so many people: the largest, so that nobody changes places with a better seen one;
    who is followed already is preferred to somebody as large."""
    size = [size_of(person.body) * (PREFERRED if person.age else 1.0) for person in people]
    rows = sorted(range(len(people)), key=lambda row: -size[row])[:most_people]
    return [people[row] for row in sorted(rows)]


def distance_of(a: Crop, b: Crop) -> float:
    """Distance of the middles of two crops, in sides of the larger."""
    return float(np.hypot(a.x - b.x, a.y - b.y)) / max(a.side, b.side)


def is_followed(box: PersonBox, bodies: Sequence[Landmarks]) -> bool:
    """Whether one of the bodies fills a box."""
    return any(overlap(corners_of(body), box.corners) > FOLLOWED for body in bodies)
