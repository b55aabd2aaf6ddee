"""Even motion: pictures in which nobody needs to be looked at, as the looks around them tell.

Linear interpolation halfway between two looks errs by an eighth of the second difference. Where
that is much less than what the network errs by, a look would add its time and little else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .landmarks import Landmarks
from .overlap import LIMBS, size_of

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
