"""Spans of frames in which a point of a foot is in contact with the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from imocap_core.motion.terms.foot_contact import contact_share
from imocap_core.runs import runs

SPEED_M_S = 0.05  # of a foot whose contact counts a quarter, as in the fit of the common motion
LEAST_SHARE = 0.25
SHORTEST_S = 0.15  # of a contact
GAP_S = 0.1  # shorter ones end no contact
AWAY_M = 0.01  # from where it stands, at a contact's ends
HEIGHT_M = 0.2  # above the ground: a foot that is held still in the air is none on the ground


@dataclass(frozen=True)
class Span:
    """Frames from `first` to `last`, both included."""

    first: int
    last: int

    @property
    def frames(self) -> slice:
        """As an index."""
        return slice(self.first, self.last + 1)

    def common(self, other: Span) -> Span | None:
        """The frames of both; None when there is none."""
        first, last = max(self.first, other.first), min(self.last, other.last)
        return Span(first, last) if first <= last else None


def in_contact(
    points: Float[np.ndarray, "T F 3"], height_m: Float[np.ndarray, "T F"], fps: float
) -> Bool[np.ndarray, "steps F"]:
    """Whether points of the feet are in contact from each frame to the next.

    As the fit holds them (`contact_share`), on the result's own motion, near the ground only.
    """
    steps = torch.as_tensor(np.diff(points, axis=0))[None]
    share = contact_share(steps, fps, speed_m_s=SPEED_M_S)[0].numpy()
    low = np.maximum(height_m[1:], height_m[:-1]) < HEIGHT_M
    return (share >= LEAST_SHARE) & low


def spans_of(
    contact: Bool[np.ndarray, " steps"], path: Float[np.ndarray, "T 3"], fps: float
) -> list[Span]:
    """The frames of each contact of one point, whose path is in metres.

    Gaps of less than `GAP_S` are closed. A contact begins and ends within `AWAY_M` of its median
    place: the estimate looks at 0.4 s. Those shorter than `SHORTEST_S` are left out.
    """
    steps = runs(contact, gap=math.ceil(GAP_S * fps) - 1)
    spans = [Span(first, last + 1) for first, last in steps]  # step t is from frame t to t + 1
    trimmed = [_trimmed(span, path) for span in spans]
    return [span for span in trimmed if span.last - span.first >= SHORTEST_S * fps]


def _trimmed(span: Span, path: Float[np.ndarray, "T 3"]) -> Span:
    stands = path[span.frames]
    away = np.linalg.norm(stands - np.median(stands, axis=0), axis=1)
    near = np.flatnonzero(away <= AWAY_M)
    return Span(span.first + int(near[0]), span.first + int(near[-1])) if len(near) else span
