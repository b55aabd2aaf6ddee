"""Everybody through a video: where each picture is looked at.

Each person's next crop follows from the last landmarks. The person detector looks at the whole
picture every few frames and whenever somebody was lost; a box in which nobody is followed is a new
person, who is also followed backward through the last pictures.

While somebody moves evenly, a picture waits for the next one, and while all do, three wait for the
fourth. Who that shows to have gone on so is not looked at in the pictures between.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .boxes import PersonBox, detect_boxes, overlap
from .crops import Crop, is_same
from .even import LONGEST, LOOKS, between, is_even
from .followed import FollowedPerson, distance_of, is_followed, largest, merged
from .hidden import with_hidden
from .landmarks import Landmarks, detect_landmarks
from .networks import Network
from .overlap import in_front_first, is_duplicate, is_in_the_way, quality, shared, step
from .person import detect_people

EVERY = 5  # frames from one look at the whole picture to the next
PATIENCE = 30  # frames in which a box with nobody new in it is not looked at again
SAME_BOX = 0.5  # intersection over union
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
        self._refused: list[tuple[int, PersonBox]] = []  # frame, box with nobody new in it
        self._frame = -1
        self._gap = 1  # frames from the last look to the next
        self._waiting: list[np.ndarray] = []  # the pictures since the last look

    def next_people(
        self, picture: np.ndarray, is_last: bool = False
    ) -> tuple[list[Landmarks], Earlier]:
        """Everybody in the next picture (H, W, 3), RGB, and the people of earlier ones who were
        overlooked, or waited for this one."""
        self._frame += 1
        self._waiting.append(picture)
        if len(self._waiting) < self._gap and not is_last:
            return [], []
        waiting, self._waiting = self._waiting, []
        bodies, overlooked = self._through(waiting, self._frame)
        self._gap = self._next_gap()
        ago = reversed(range(1, len(bodies)))
        return bodies[-1], [
            *((n, body) for n, people in zip(ago, bodies, strict=False) for body in people),
            *overlooked,
        ]

    def _next_gap(self) -> int:
        """Frames to the next look: one where somebody is new, or nobody moves evenly; most where
        all do. Who is in another's way is looked at in every picture."""
        people, bodies = self._people, [person.body for person in self._people]
        if self._every_picture or any(person.age <= EVERY for person in people):
            return 1
        if any(is_in_the_way(a, b) for a in bodies for b in bodies if a is not b):
            return 1
        if people and all(is_even(person.looks, LONGEST) for person in people):
            return LONGEST
        return 2 if any(is_even(person.looks, 2) for person in people) else 1

    def _through(
        self, pictures: Sequence[np.ndarray], frame: int
    ) -> tuple[list[list[Landmarks]], Earlier]:
        """Everybody in each of the pictures since the last look, and the people overlooked before;
        frame: number of the last one. Where that shows that somebody was lost, or that not all
        moved evenly through several, the middle one is looked at first."""
        *waiting, last = pictures
        if not waiting:
            now, overlooked = self._looked(last, frame)
            return [now], overlooked
        followed = self._followed(last, frame, self._people)
        is_complete = len(merged(followed, [])) == len(self._people)
        gap = len(pictures)
        if is_complete and (gap == 2 or all(is_even(person.looks, gap) for person in followed)):
            bodies, followed = self._between(waiting, frame, followed)
            for picture, people in zip(waiting, bodies, strict=True):
                self._remember(picture, people)
            self._until_boxes -= len(waiting)
            now, overlooked = self._taken(last, followed)
            return [*map(with_hidden, bodies), now], overlooked
        rest = gap - gap // 2
        first, early = self._through(pictures[:-rest], frame - rest)
        second, overlooked = self._through(pictures[-rest:], frame)
        return first + second, [(ago + rest, body) for ago, body in early] + overlooked

    def _between(
        self, pictures: Sequence[np.ndarray], frame: int, followed: Sequence[FollowedPerson]
    ) -> tuple[list[list[Landmarks]], list[FollowedPerson]]:
        """Everybody's bodies in the pictures that waited for the one of this number, and the people
        of that one: who did not move evenly is looked at in all."""
        gap = len(pictures) + 1
        even = [person for person in followed if is_even(person.looks, gap)]
        names = {id(person.first) for person in even}
        others = [person for person in self._people if id(person.first) not in names]
        bodies = []
        for n, picture in enumerate(pictures, start=1):
            here = [between(person.looks[-2].body, person.body, n / gap) for person in even]
            others = self._followed(picture, frame - gap + n, others, here) if others else []
            bodies.append(here + [person.body for person in others])
        looks = {id(person.first): person.looks for person in others}
        people = [
            replace(p, looks=(*looks.get(id(p.first), p.looks[:-1]), p.looks[-1])[-LOOKS:])
            for p in followed
        ]
        return bodies, people

    def _looked(self, picture: np.ndarray, frame: int) -> tuple[list[Landmarks], Earlier]:
        """Everybody in a picture, and the people overlooked in those before."""
        return self._taken(picture, self._followed(picture, frame, self._people))

    def _taken(
        self, picture: np.ndarray, followed: Sequence[FollowedPerson]
    ) -> tuple[list[Landmarks], Earlier]:
        """The same, given the people of the last picture in this one."""
        people = merged(followed, [])
        self._until_boxes -= 1
        is_lost = not people or len(people) < len(self._people)
        if is_lost:
            self._refused = []
        if self._until_boxes < 0 or is_lost:
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
        """New people in boxes in which nobody is followed, each looked at twice."""
        since = self._frame - PATIENCE
        self._refused = [(frame, box) for frame, box in self._refused if frame > since]
        fresh: list[Landmarks] = []
        for box in detect_boxes(picture, self._boxes, self._least_person)[: self._most_people]:
            others = [*bodies, *fresh]
            if is_followed(box, others) or self._is_refused(box):
                continue
            body = self._new(picture, box.crop, others)
            if body:
                fresh.append(body)
            else:
                self._refused.append((self._frame, box))
        return fresh

    def _is_refused(self, box: PersonBox) -> bool:
        """Whether nobody new was in a box a short time ago."""
        return any(overlap(box.corners, other.corners) > SAME_BOX for _, other in self._refused)

    def _new(
        self, picture: np.ndarray, crop: Crop, others: Sequence[Landmarks]
    ) -> Landmarks | None:
        """The body in a crop, looked at again in the crop that it gives; None where that is nobody,
        or one of the others."""
        body: Landmarks | None = None
        for _ in range(2):
            answer = self._look(picture, crop)
            if answer is None:
                return None
            body = self._apart(picture, crop, answer, others)
            if is_duplicate(body, others):
                return None
            crop = body.next_crop
        return body

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
