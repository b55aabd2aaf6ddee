"""Looks at one picture: the body in a crop, apart from and behind other people.

Even motion: pictures in which nobody needs to be looked at, as the looks around them tell. Linear
interpolation halfway between two looks errs by an eighth of the second difference. Where that is
much less than what the network errs by, a look would add its time and little else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .boxes import (
    LIMBS,
    PersonBox,
    corners_of,
    detect_people,
    distinct,
    is_duplicate,
    is_in_the_way,
    overlap,
    quality,
    shared,
    size_of,
)
from .landmarks import Crop, Landmarks, Network, Pyramid, about, detect_landmarks, is_same
from .movenet import (
    POINTS,
    combined,
    crop_about,
    detect_points,
    is_doubted,
    peaks_of,
    points_of,
    seen_in,
)

LARGEST_ERROR = 0.005  # of the body's size; the network errs by three times as much
VISIBLE = 0.5  # joints that are seen less take no part: their places jump
LOOKS = 5  # of a person, that are kept
LONGEST = 4  # frames from one look to the next, at most


@dataclass(frozen=True)
class Look:
    """A body in a picture that was looked at, by the picture's number."""

    frame: int
    body: Landmarks


def is_even(looks: Sequence[Look], gap: int) -> bool:
    """Whether a body moves so evenly that its places between two looks, `gap` frames apart, would
    be interpolated well: judged by three looks about as far apart, of which a detector's noise
    bends the course less than of near ones."""
    three = _spread(looks, gap)
    return bool(three) and interpolation_error(three, gap) < LARGEST_ERROR


def _spread(looks: Sequence[Look], gap: int) -> list[Look]:
    """The last look, and two before it, each as nearly as can be `gap` frames before the next;
    none where there are not three."""
    if len(looks) < 3:
        return []
    c = looks[-1]
    b = min(looks[1:-1], key=lambda look: abs(c.frame - look.frame - gap))
    before = [look for look in looks if look.frame < b.frame]
    return [min(before, key=lambda look: abs(b.frame - look.frame - gap)), b, c]


def interpolation_error(looks: Sequence[Look], gap: int) -> float:
    """Largest error of a visible limb joint halfway between two looks, in sizes of the body; 0
    where none is visible in all three.

    Args:
        looks: three of one body; gap: frames from one to the next.
    """
    a, b, c = looks
    later = (c.body.xy_px - b.body.xy_px) / (c.frame - b.frame)
    earlier = (b.body.xy_px - a.body.xy_px) / (b.frame - a.frame)
    bend = 2 * (later - earlier) / (c.frame - a.frame)  # pixels per frame^2
    least = np.min([look.body.visibility for look in looks], axis=0)
    visible = [joint for joint in LIMBS if least[joint] >= VISIBLE]
    largest = np.linalg.norm(bend[visible], axis=1).max(initial=0.0)
    return float(largest) * gap**2 / 8 / size_of(c.body)


def between(a: Landmarks, b: Landmarks, share: float) -> Landmarks:
    """The body between two looks, `share` of the way; crop and mask are the second one's."""

    def mean(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.asarray((1 - share) * one + share * other)

    second = b.second_xy_px
    if a.second_xy_px is not None and second is not None:
        second = mean(a.second_xy_px, second)
    return replace(
        b,
        second_xy_px=second,
        xy_px=mean(a.xy_px, b.xy_px),
        z_px=mean(a.z_px, b.z_px),
        visibility=mean(a.visibility, b.visibility),
        world_m=mean(a.world_m, b.world_m),
        presence=min(a.presence, b.presence),
    )


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


CONTESTED = 0.25  # share of joints at those of others, beyond which a body is not itself
LEAST_QUALITY = 0.75  # of a body with others painted over, of that without
LEAST_DETECTED = 0.5  # confidence of a person whom BlazePose's detector gives
NEAR = 0.5  # sides of a crop: further away it is somebody else


@dataclass(frozen=True)
class Looks:
    """The networks that look at a person; least_presence: of the body in a crop; second: looks at
    the limbs too."""

    person_detector: Network
    landmarks: Network
    least_presence: float
    second: Network | None = None

    def body(
        self, picture: Pyramid, crop: Crop, others: Sequence[Landmarks] = ()
    ) -> Landmarks | None:
        """The body in a crop, None where nobody is."""
        body = detect_landmarks(picture, crop, self.landmarks, others)
        return body if body.presence >= self.least_presence else None

    def apart(
        self, picture: Pyramid, crop: Crop, body: Landmarks, others: Sequence[Landmarks]
    ) -> Landmarks:
        """The body in a crop, looked at again with the people painted over who are in its way; as
        it was where that shows less of it, and it had hardly any of their joints."""
        rivals = [other for other in others if is_in_the_way(other, body)]
        again = self.body(picture, crop, rivals) if rivals else None
        if again is None:
            return body
        is_worse = quality(again) < LEAST_QUALITY * quality(body)
        return body if is_worse and shared(body, rivals) < CONTESTED else again

    def with_second_points(self, picture: Pyramid, body: Landmarks) -> Landmarks:
        """The body with the second network's points."""
        if self.second is None or body.second_xy_px is not None:
            return body
        points = detect_points(picture, crop_about(body), self.second)
        return replace(body, second_xy_px=points)

    def in_next_crops(
        self, picture: Pyramid, people: Sequence[FollowedPerson]
    ) -> list[tuple[FollowedPerson, Landmarks | None]]:
        """People with their bodies in the crops that the last picture gives; where the two networks
        disagree about somebody, also in those that BlazePose's own detector gives."""
        answers: list[tuple[FollowedPerson, Landmarks | None]] = []
        for person in people:
            body = self.body(picture, person.body.next_crop)
            answers.append((person, body and self.with_second_points(picture, body)))
        if all(body and not is_doubted(body) for _, body in answers):
            return answers
        return self._with_detected_crops(picture, answers)

    def somebody_new(
        self, picture: Pyramid, crop: Crop, others: Sequence[Landmarks]
    ) -> Landmarks | None:
        """The body in a crop, looked at again in the crop that it gives; None where that is nobody,
        or one of the others."""
        body: Landmarks | None = None
        for _ in range(2):
            answer = self.body(picture, crop)
            if answer is None:
                return None
            body = self.apart(picture, crop, answer, others)
            if is_duplicate(body, others):
                return None
            crop = body.next_crop
        return body

    def _with_detected_crops(
        self, picture: Pyramid, answers: list[tuple[FollowedPerson, Landmarks | None]]
    ) -> list[tuple[FollowedPerson, Landmarks | None]]:
        """The answers, each replaced by a better one in the crop that BlazePose's own detector
        gives the nearest person: it knows how a body is turned, which a drifting one forgets."""
        better = list(answers)
        for detected in detect_people(picture, self.person_detector, LEAST_DETECTED):
            crop = detected.crop
            away = [distance_of(crop, person.body.next_crop) for person, _ in answers]
            row = int(np.argmin(away))
            person, body = better[row]
            if away[row] > NEAR or is_same(crop, person.body.next_crop):
                continue
            fresh = self.body(picture, crop)
            others = [other for k, (_, other) in enumerate(answers) if k != row and other]
            if fresh and shared(fresh, others) < CONTESTED:
                best = max((fresh, body), key=quality) if body else fresh
                better[row] = (person, best)
        return better


KINDS = {"elbow": (13, 14), "wrist": (15, 16), "knee": (25, 26), "ankle": (27, 28)}  # left, right
HIPS, SHOULDERS = [23, 24], [11, 12]
RIM = 1.02  # of the distance from the hips to the farthest point: the circle about the whole body


def look_at(
    picture: Pyramid, place: np.ndarray, network: Network, second: Network | None
) -> dict[str, Any]:
    """What the networks see about the points (33, 2) that a person is expected to have, pixels.

    Of `KINDS` the `limbs`, places [x, y] at which the joint of one of both sides may be, by both
    networks and by the second one's highest heat; `body`, 33 of [x, y, visibility], as the detector
    has it; `presence`, the probability of a person.
    """
    body = detect_landmarks(picture, crop_of_body(place), network)
    limbs = [[body.xy_px[k].tolist() for k in kind] for kind in KINDS.values()]
    if second is not None:
        crop = crop_about(replace(body, xy_px=place))
        outputs = seen_in(picture, crop, second)
        body = replace(body, second_xy_px=points_of(outputs, crop))
        assert body.second_xy_px is not None
        peaks = peaks_of(outputs, crop)
        for places, kind in zip(limbs, KINDS.values(), strict=True):
            for point in map(POINTS.index, kind):
                places += [body.second_xy_px[point].tolist(), *peaks[point].tolist()]
    body = combined(body)
    rows = np.column_stack([body.xy_px, body.visibility])
    return {"limbs": limbs, "body": rows.tolist(), "presence": body.presence}


def crop_of_body(place: np.ndarray) -> Crop:
    """The crop about a whole body, its trunk upright."""
    hips = place[HIPS].mean(axis=0)
    up = place[SHOULDERS].mean(axis=0) - hips
    reach = RIM * np.linalg.norm(place - hips, axis=1).max()
    return about(hips, hips + reach * up / max(np.linalg.norm(up), 1e-6))
