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
LOOKS = 3  # of a person, from which a second difference follows


@dataclass(frozen=True)
class Look:
    """A body in a picture that was looked at, by the picture's number."""

    frame: int
    body: Landmarks


def is_even(looks: Sequence[Look], gap: int) -> bool:
    """Whether a body moves so evenly that its places halfway between two looks, `gap` frames apart,
    would be interpolated well: judged by the last three looks."""
    if len(looks) < LOOKS:
        return False
    return interpolation_error(looks[-LOOKS:], gap) < LARGEST_ERROR


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


def halfway(a: Landmarks, b: Landmarks) -> Landmarks:
    """The body halfway between two looks; crop and mask are the second one's."""
    return replace(
        b,
        xy_px=(a.xy_px + b.xy_px) / 2,
        z_px=(a.z_px + b.z_px) / 2,
        visibility=(a.visibility + b.visibility) / 2,
        world_m=(a.world_m + b.world_m) / 2,
        presence=min(a.presence, b.presence),
    )
