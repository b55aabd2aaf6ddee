"""People who are followed from picture to picture: who is one, who is new, who is nearest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .boxes import PersonBox, overlap
from .crops import Crop
from .even import LOOKS, Look
from .landmarks import Landmarks
from .overlap import corners_of, distinct, size_of

FOLLOWED = 0.5  # intersection over union of the box of a person who is followed and the detector's
ESTABLISHED = 5  # looks after the first: from then on nobody new takes a person's place
PREFERRED = 1.3  # of their size: people who are followed already


@dataclass(frozen=True)
class FollowedPerson:
    """A followed person: the landmarks now and those of the first frame, `age` looks ago, and the
    last looks."""

    body: Landmarks
    first: Landmarks
    age: int = 0
    looks: tuple[Look, ...] = ()

    @property
    def is_established(self) -> bool:
        """Whether the person is followed for some time."""
        return self.age > ESTABLISHED

    def with_look(self, frame: int, body: Landmarks) -> FollowedPerson:
        """The same person in a later picture."""
        looks = (*self.looks, Look(frame, body))[-LOOKS:]
        return replace(self, body=body, age=self.age + 1, looks=looks)


def merged(followed: Sequence[FollowedPerson], fresh: Sequence[Landmarks]) -> list[FollowedPerson]:
    """Different people: the established, then who is followed for less long, then who is new; of
    each the best seen first."""
    people = [*followed, *(FollowedPerson(body, body) for body in fresh)]
    ranks = [0 if p.is_established else 1 for p in followed] + [2] * len(fresh)
    return [people[row] for row in distinct([person.body for person in people], ranks)]


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
