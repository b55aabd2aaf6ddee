"""Everybody through a video: where each picture is looked at.

Each person's next crop follows from the last landmarks. The person detector looks at the whole
picture every few frames and whenever somebody was lost; a box in which nobody is followed is a new
person, who is also followed backward through the last pictures.

While somebody moves evenly, every second picture waits for the next one. Who that shows to have
gone on so is not looked at in the picture between.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .boxes import detect_boxes
from .crops import Crop, is_same
from .even import LOOKS, halfway, is_even
from .followed import FollowedPerson, distance_of, is_followed, largest, merged
from .hidden import with_hidden
from .landmarks import Landmarks, detect_landmarks
from .networks import Network
from .overlap import in_front_first, is_duplicate, is_in_the_way, quality, shared, step
from .person import detect_people

EVERY = 5  # frames from one look at the whole picture to the next
CONTESTED = 0.25  # share of joints at those of others, beyond which a body is not itself
LEAST_QUALITY = 0.75  # of a body with others painted over, of that without
LEAST_DETECTED = 0.5  # confidence of a person whom BlazePose's detector gives
NEAR = 0.5  # sides of a crop: further away it is somebody else
MOST_BYTES = 200_000_000  # of the last pictures
Earlier = list[tuple[int, Landmarks]]  # so many frames ago


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
        *,
        every_picture: bool = False,
    ) -> None:
        """every_picture: look at each, however evenly everybody moves."""
        self._boxes, self._person_detector, self._landmarks = boxes, person_detector, landmarks
        self._least_person, self._least_presence = least_person, least_presence
        self._most_people, self._every_picture = most_people, every_picture
        self._people: list[FollowedPerson] = []
        self._last: deque[tuple[np.ndarray, list[Landmarks]]] = deque()
        self._until_boxes = 0
        self._frame = -1
        self._waiting: np.ndarray | None = None  # the last picture, not looked at yet

    def next_people(
        self, picture: np.ndarray, is_last: bool = False
    ) -> tuple[list[Landmarks], Earlier]:
        """Everybody in the next picture (H, W, 3), RGB, and the people of earlier ones who were
        overlooked, or waited for this one."""
        self._frame += 1
        if self._waiting is None:
            if not is_last and self._can_wait():
                self._waiting = picture
                return [], []
            return self._looked(picture, self._frame)
        waiting, self._waiting = self._waiting, None
        followed = self._followed(picture, self._frame, self._people)
        if len(merged(followed, [])) == len(self._people):
            between, followed = self._between(waiting, followed)
            self._remember(waiting, between)
            self._until_boxes -= 1
            now, earlier = self._taken(picture, followed)
            return now, [(1, body) for body in with_hidden(between)] + earlier
        before, overlooked = self._looked(waiting, self._frame - 1)
        earlier = [(1, body) for body in before]
        earlier += [(ago + 1, body) for ago, body in overlooked]
        now, overlooked = self._looked(picture, self._frame)
        return now, earlier + overlooked

    def _can_wait(self) -> bool:
        """Whether nobody is new, and somebody moves evenly."""
        if self._every_picture or any(person.age <= EVERY for person in self._people):
            return False
        return any(is_even(person.looks, gap=2) for person in self._people)

    def _between(
        self, waiting: np.ndarray, followed: Sequence[FollowedPerson]
    ) -> tuple[list[Landmarks], list[FollowedPerson]]:
        """Everybody's bodies in the picture that waited, and the people of the next one: who did
        not move evenly is looked at in both."""
        even = [person for person in followed if is_even(person.looks, gap=2)]
        bodies = [halfway(person.looks[-2].body, person.body) for person in even]
        names = {id(person.first) for person in even}
        others = [person for person in self._people if id(person.first) not in names]
        looked = self._followed(waiting, self._frame - 1, others, bodies)
        looks = {id(person.first): person.looks for person in looked}
        people = [
            replace(p, looks=(*looks.get(id(p.first), p.looks[:-1]), p.looks[-1])[-LOOKS:])
            for p in followed
        ]
        return bodies + [person.body for person in looked], people

    def _looked(self, picture: np.ndarray, frame: int) -> tuple[list[Landmarks], Earlier]:
        """Everybody in a picture, and the people overlooked in those before."""
        return self._taken(picture, self._followed(picture, frame, self._people))

    def _taken(
        self, picture: np.ndarray, followed: Sequence[FollowedPerson]
    ) -> tuple[list[Landmarks], Earlier]:
        """The same, given the people of the last picture in this one."""
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

    def _followed(
        self,
        picture: np.ndarray,
        frame: int,
        last: Sequence[FollowedPerson],
        in_place: Sequence[Landmarks] = (),
    ) -> list[FollowedPerson]:
        """The people of the last picture in this one: the best seen first, the others then without
        them, where they are in the way; in_place: bodies of others there."""
        answers = [(p, self._look(picture, p.body.next_crop)) for p in last]
        answers = self._with_detected_crops(picture, answers)
        present = [(p, body) for p, body in answers if body]
        steps = [step(body, p.body) for p, body in present]
        bodies = [body for _, body in present]
        people: list[FollowedPerson] = []
        for row in in_front_first(bodies, steps):
            person, body = present[row]
            others = [*in_place, *(other.body for other in people if other.age >= EVERY)]
            best = self._apart(picture, person.body.next_crop, body, others)
            people.append(person.with_look(frame, best))
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
