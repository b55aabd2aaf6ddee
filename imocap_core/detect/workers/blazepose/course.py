"""Everybody through a video: where each picture is looked at.

How many pictures wait for the next one that is looked at. Each person's next crop follows from the
last landmarks. The person detector looks at the whole picture every few frames and whenever
somebody was lost; a box in which nobody is followed is a new person, who is also followed backward
through the last pictures.

While somebody moves evenly, a picture waits for the next one, and while all do, three wait for the
fourth. Who that shows to have gone on so is not looked at in the pictures between.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from .boxes import (
    RefusedBoxes,
    detect_boxes,
    in_front_first,
    is_duplicate,
    is_in_the_way,
    step,
    with_hidden,
)
from .landmarks import Landmarks, Network, Pyramid
from .looks import (
    ESTABLISHED,
    LONGEST,
    LOOKS,
    FollowedPerson,
    Looks,
    between,
    is_even,
    is_followed,
    largest,
    merged,
)
from .movenet import combined


def frames_to_next_look(people: Sequence[FollowedPerson]) -> int:
    """One where somebody is new, or nobody moves evenly; two where somebody does, LONGEST where all
    do and nobody is in another's way."""
    if any(not person.is_established for person in people):
        return 1
    is_even_long = people and all(is_even(person.looks, LONGEST) for person in people)
    if is_even_long and not any(
        is_in_the_way(a.body, b.body) or is_in_the_way(b.body, a.body)
        for a, b in combinations(people, 2)
    ):
        return LONGEST
    return 2 if any(is_even(person.looks, 2) for person in people) else 1


EVERY = 5  # frames from one look at the whole picture to the next
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
        second: Network | None = None,
        every_picture: bool = False,
    ) -> None:
        """second: looks at the limbs of everybody too. every_picture: look at each, however evenly
        everybody moves."""
        self._boxes, self._least_person = boxes, least_person
        self._looks = Looks(person_detector, landmarks, least_presence, second)
        self._most_people, self._every_picture = most_people, every_picture
        self._people: list[FollowedPerson] = []
        self._last: deque[tuple[Pyramid, list[Landmarks]]] = deque()
        self._until_boxes = 0
        self._refused = RefusedBoxes()
        self._frame = -1
        self._gap = 1  # frames from the last look to the next
        self._waiting: list[Pyramid] = []  # the pictures since the last look

    def next_people(
        self, picture: np.ndarray, is_last: bool = False
    ) -> tuple[list[Landmarks], Earlier]:
        """Everybody in the next picture (H, W, 3), RGB, and the people of earlier ones who were
        overlooked, or waited for this one."""
        self._frame += 1
        self._waiting.append(Pyramid(picture))
        if len(self._waiting) < self._gap and not is_last:
            return [], []
        waiting, self._waiting = self._waiting, []
        bodies, overlooked = self._through(waiting, self._frame)
        self._gap = 1 if self._every_picture else frames_to_next_look(self._people)
        ago = reversed(range(1, len(bodies)))
        return bodies[-1], [
            *((n, body) for n, people in zip(ago, bodies, strict=False) for body in people),
            *overlooked,
        ]

    def _through(
        self, pictures: Sequence[Pyramid], frame: int
    ) -> tuple[list[list[Landmarks]], Earlier]:
        """Everybody in each of the pictures since the last look, and the people overlooked before;
        frame: number of the last one. Where that shows that somebody was lost, or that not all
        moved evenly through several, or where somebody was new before, an earlier one is looked at
        first."""
        *waiting, last = pictures
        if waiting and not all(person.is_established for person in self._people):
            return self._one_after_another(pictures, 1, frame)
        followed = self._followed(last, frame, self._people)
        if not waiting:
            now, overlooked = self._taken(last, followed)
            return [now], overlooked
        is_complete = len(merged(followed, [])) == len(self._people)
        gap = len(pictures)
        if is_complete and (gap == 2 or all(is_even(person.looks, gap) for person in followed)):
            bodies, followed = self._between(waiting, frame, followed)
            for picture, people in zip(waiting, bodies, strict=True):
                self._remember(picture, people)
            self._until_boxes -= len(waiting)
            now, overlooked = self._taken(last, followed)
            return [*map(_answers, bodies), now], overlooked
        return self._one_after_another(pictures, gap // 2, frame)

    def _one_after_another(
        self, pictures: Sequence[Pyramid], count: int, frame: int
    ) -> tuple[list[list[Landmarks]], Earlier]:
        """The same, the first `count` pictures before the others."""
        rest = len(pictures) - count
        first, early = self._through(pictures[:count], frame - rest)
        second, overlooked = self._through(pictures[count:], frame)
        return first + second, [(ago + rest, body) for ago, body in early] + overlooked

    def _between(
        self, pictures: Sequence[Pyramid], frame: int, followed: Sequence[FollowedPerson]
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

    def _taken(
        self, picture: Pyramid, followed: Sequence[FollowedPerson]
    ) -> tuple[list[Landmarks], Earlier]:
        """Everybody in a picture, given the people of the last one in it, and the people overlooked
        in those before."""
        people = merged(followed, [])
        self._until_boxes -= 1
        is_lost = not people or bool(self._lost(people))
        if is_lost:
            self._refused.forget()
        if self._until_boxes < 0 or is_lost:
            people = merged(followed, self._fresh(picture, [person.body for person in people]))
            self._until_boxes = EVERY - 1
        self._people = largest(people, self._most_people)
        new = [person for person in self._people if person.age == ESTABLISHED]
        earlier = [past for person in new for past in self._backward(person)]
        self._remember(picture, [person.body for person in self._people])
        return _answers([person.body for person in self._people]), earlier

    def _lost(self, people: Sequence[FollowedPerson]) -> list[FollowedPerson]:
        """Who was followed for some time, and is not among the people."""
        names = {id(person.first) for person in people}
        return [p for p in self._people if p.is_established and id(p.first) not in names]

    def _followed(
        self,
        picture: Pyramid,
        frame: int,
        last: Sequence[FollowedPerson],
        in_place: Sequence[Landmarks] = (),
    ) -> list[FollowedPerson]:
        """The people of the last picture in this one: the best seen first, the others then without
        them, where they are in the way; in_place: bodies of others there."""
        answers = self._looks.in_next_crops(picture, last)
        present = [(p, body) for p, body in answers if body]
        steps = [step(body, p.body) for p, body in present]
        bodies = [body for _, body in present]
        people: list[FollowedPerson] = []
        for row in in_front_first(bodies, steps):
            person, body = present[row]
            others = [*in_place, *(other.body for other in people if other.age >= ESTABLISHED)]
            best = self._looks.apart(picture, person.body.next_crop, body, others)
            people.append(person.with_look(frame, self._looks.with_second_points(picture, best)))
        return people

    def _fresh(self, picture: Pyramid, bodies: Sequence[Landmarks]) -> list[Landmarks]:
        """New people in boxes in which nobody is followed, each looked at twice."""
        fresh: list[Landmarks] = []
        for box in detect_boxes(picture, self._boxes, self._least_person)[: self._most_people]:
            others = [*bodies, *fresh]
            if is_followed(box, others) or self._refused.has(self._frame, box):
                continue
            body = self._looks.somebody_new(picture, box.crop, others)
            if body:
                fresh.append(self._looks.with_second_points(picture, body))
            else:
                self._refused.add(self._frame, box)
        return fresh

    def _backward(self, person: FollowedPerson) -> Earlier:
        """A person in the last pictures before the first frame, until they are lost or another."""
        earlier: Earlier = []
        body = person.first
        for ago in range(person.age + 1, len(self._last) + 1):
            picture, others = self._last[-ago]
            crop = body.next_crop
            answer = self._looks.body(picture, crop)
            if answer is None or len(others) >= self._most_people:
                break
            body = self._looks.apart(picture, crop, answer, others)
            if is_duplicate(body, others):
                break
            others.append(self._looks.with_second_points(picture, body))
            earlier.append((ago, _answers(others)[-1]))
        return earlier

    def _remember(self, picture: Pyramid, bodies: list[Landmarks]) -> None:
        """Add a picture to the last ones, as many as there is room for."""
        self._last.append((picture, bodies))
        while len(self._last) > 1 and sum(one.nbytes for one, _ in self._last) > MOST_BYTES:
            self._last.popleft()


def _answers(bodies: Sequence[Landmarks]) -> list[Landmarks]:
    """What is said of the people of a picture."""
    return [combined(body) for body in with_hidden(bodies)]
