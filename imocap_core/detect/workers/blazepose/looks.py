"""Looks at one picture: the body in a crop, apart from other people, and where it is seen best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .both import is_doubted
from .crops import Crop, is_same
from .followed import FollowedPerson, distance_of
from .landmarks import Landmarks, detect_landmarks
from .movenet import crop_about, detect_points
from .networks import Network
from .overlap import is_duplicate, is_in_the_way, quality, shared
from .person import detect_people
from .pyramid import Pyramid

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
