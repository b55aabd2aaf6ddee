"""People who are followed from picture to picture: who is one, who is new, who is nearest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .boxes import PersonBox, overlap
from .crops import Crop
from .even import LOOKS, Look
from .landmarks import Landmarks
from .overlap import corners_of, distinct, is_duplicate, size_of

FOLLOWED = 0.5  # intersection over union of the box of a person who is followed and the detector's
KNOWN = 5  # looks, after which nobody who is new takes a person's place
PREFERRED = 1.3  # of their size: people who are followed already


@dataclass(frozen=True)
class FollowedPerson:
    """A followed person: the landmarks now and those of the first frame, `age` looks ago, and the
    last looks."""

    body: Landmarks
    first: Landmarks
    age: int = 0
    looks: tuple[Look, ...] = ()

    def with_look(self, frame: int, body: Landmarks) -> FollowedPerson:
        """The same person in a later picture."""
        looks = (*self.looks, Look(frame, body))[-LOOKS:]
        return replace(self, body=body, age=self.age + 1, looks=looks)


def merged(followed: Sequence[FollowedPerson], fresh: Sequence[Landmarks]) -> list[FollowedPerson]:
    """Different people: who is followed for some time, then who is not, then who is new; the best
    seen first."""
    established = [person for person in followed if person.age > KNOWN]
    people = [established[row] for row in distinct([person.body for person in established])]
    others = [person for person in followed if person.age <= KNOWN]
    for row in distinct([person.body for person in others]):
        if not is_duplicate(others[row].body, [person.body for person in people]):
            people.append(others[row])
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
