"""Where points of a foot stand: one place a contact, which the leg can reach in every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.motion.foot_lock.contacts import Span

ANKLE, BALL = 0, 1
ROUNDS = 500
EXACT_M = 1e-9


@dataclass(eq=False)
class Contact:
    """A contact of the ankle or the ball of a foot with its place, world, metres.

    centres: places of the hip (for the ball less the foot's vector, as the ankle is above), of each
    frame in which the leg must reach the place.
    """

    point: int
    span: Span
    place: Float[np.ndarray, "3"]
    centres: Float[np.ndarray, "N 3"]


def contacts_of(
    spans: tuple[list[Span], list[Span]],
    hip: Float[np.ndarray, "T 3"],
    ankle: Float[np.ndarray, "T 3"],
    ball: Float[np.ndarray, "T 3"],
    reach_m: float,
) -> list[Contact]:
    """The contacts of one foot; those at the same time have the foot's length between them.

    A place is the mean over the contact, moved as little as it takes: alternating projections onto
    the spheres about the hips that the leg reaches (convex), and onto the foot's length.
    """
    contacts = []
    for span in spans[ANKLE]:
        place = ankle[span.frames].mean(axis=0)
        contacts.append(Contact(ANKLE, span, place, hip[span.frames]))
    for span in spans[BALL]:
        alone = np.ones(span.last - span.first + 1, dtype=bool)
        for other in spans[ANKLE]:
            alone[max(other.first - span.first, 0) : max(other.last + 1 - span.first, 0)] = False
        centres = (hip + ball - ankle)[span.frames][alone]
        contacts.append(Contact(BALL, span, ball[span.frames].mean(axis=0), centres))
    pairs = [
        (a, b)
        for a in contacts
        for b in contacts
        if (a.point, b.point) == (ANKLE, BALL) and a.span.common(b.span)
    ]
    length = float(np.linalg.norm(ball[0] - ankle[0]))
    for _ in range(ROUNDS):
        change = max((_into_reach(c, reach_m) for c in contacts), default=0.0)
        change = max([change, *(_to_length(a, b, length) for a, b in pairs)])
        if change < EXACT_M:
            break
    return contacts


def _into_reach(contact: Contact, reach_m: float) -> float:
    """Move a place into the farthest sphere; by how much."""
    if len(contact.centres) == 0:
        return 0.0
    away = contact.place - contact.centres
    distance = np.linalg.norm(away, axis=1)
    t = int(distance.argmax())
    over = float(distance[t] - reach_m)
    if over <= 0:
        return 0.0
    contact.place = contact.place - away[t] * over / distance[t]
    return over


def _to_length(a: Contact, b: Contact, length: float) -> float:
    """Move two places to a distance from each other; by how much."""
    between = b.place - a.place
    distance = float(np.linalg.norm(between))
    shift = between * (distance - length) / (2 * distance)
    a.place, b.place = a.place + shift, b.place - shift
    return abs(distance - length)
