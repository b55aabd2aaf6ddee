"""The people between two frames of keypoints, each joint on the straight line."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

NEAR = 1e-6

People = Float[np.ndarray, "_ K 3"]


def between_people(people: Mapping[int, People], number: float, nobody: People) -> People:
    """Everybody at a fractional frame number: x, y, confidence.

    Whoever is in both frames about it is between them, the others are as in the nearer frame.
    """
    before = int(np.floor(number + NEAR))
    share = number - before
    here = people.get(before, nobody)
    if share <= NEAR:
        return here
    then = people.get(before + 1, nobody)
    nearer, other = (here, then) if share <= 0.5 else (then, here)
    weight = max(share, 1 - share)
    return np.array([_mixed(p, other, weight) for p in nearer]) if len(nearer) else nearer


def _mixed(person: Float[np.ndarray, "K 3"], others: People, weight: float) -> np.ndarray:
    """A person moved towards the one of `others` who is nearest, within their own size."""
    visible = person[:, 2] > 0
    if not len(others) or not visible.any():
        return person
    away = np.linalg.norm(others[..., :2] - person[:, :2], axis=-1)
    both = visible & (others[..., 2] > 0)
    mean = np.array([a[b].mean() if b.any() else np.inf for a, b in zip(away, both, strict=True)])
    extent = np.ptp(person[visible, :2], axis=0).max()
    k = int(np.argmin(mean))
    if not mean[k] < extent:
        return person
    mixed = weight * person + (1 - weight) * others[k]
    return np.where(both[k][:, None], mixed, person)
