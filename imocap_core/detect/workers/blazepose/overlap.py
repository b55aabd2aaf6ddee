"""Duplicates: two crops that landed on one person."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .hidden import IN_MASK, share_there
from .landmarks import Landmarks, mask_in

LIMBS = [11, 13, 15, 23, 25, 27, 12, 14, 16, 24, 26, 28]  # left, then right
OTHER_SIDE = np.roll(np.arange(12), 6)
SAME_JOINT = 0.07  # of the body's size: so near lie a joint of one person, detected twice
ONE_PERSON = 0.5  # share of joints, or of pixels, of two answers about one person
CELLS = 16  # a side of the grid of points in the box of a body
IN_THE_WAY = 0.03  # share of the box that another person covers


def quality(body: Landmarks) -> float:
    """How well a body is seen: the probability of a person, times the mean visibility."""
    return body.presence * float(body.visibility.mean())


def distinct(bodies: Sequence[Landmarks], ranks: Sequence[int]) -> list[int]:
    """Rows of the bodies that are different people: those of the lowest rank first, of one rank the
    best seen.

    A body with half its joints where those of people before it are is none: it is one of them, or
    put together of several.
    """
    rows: list[int] = []
    for row in sorted(range(len(bodies)), key=lambda row: (ranks[row], -quality(bodies[row]))):
        if not is_duplicate(bodies[row], [bodies[other] for other in rows]):
            rows.append(row)
    return rows


def is_duplicate(body: Landmarks, others: Sequence[Landmarks]) -> bool:
    """Whether half of a body's joints are those of others, or of the pixels of both masks."""
    if shared(body, others) >= ONE_PERSON:
        return True
    return any(mask_overlap(body, other) >= ONE_PERSON for other in others)


def mask_overlap(a: Landmarks, b: Landmarks) -> float:
    """Intersection over union of the masks of two bodies, in the crop of the first."""
    one, other = a.mask > IN_MASK, mask_in(a.crop, b) > IN_MASK
    union = int((one | other).sum())
    return float((one & other).sum()) / union if union else 0.0


def shared(body: Landmarks, others: Sequence[Landmarks]) -> float:
    """Share of a body's joints that are joints of others; their sides may be exchanged."""
    taken = np.zeros(len(LIMBS), bool)
    for other in others:
        limit = SAME_JOINT * min(size_of(body), size_of(other))
        places, others_places = body.xy_px[LIMBS], other.xy_px[LIMBS]
        near = [
            np.linalg.norm(places - rows, axis=1) < limit
            for rows in (others_places, others_places[OTHER_SIDE])
        ]
        taken |= max(near, key=lambda joints: int(joints.sum()))
    return float(taken.mean())


def is_in_the_way(other: Landmarks, body: Landmarks) -> bool:
    """Whether another person's pixels are in the box of a body, or its joints are the other's."""
    (x0, y0), (x1, y1) = corners_of(body)
    x, y = np.linspace(x0, x1, CELLS), np.linspace(y0, y1, CELLS)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    covered = float((share_there(other, grid) > IN_MASK).mean())
    return covered > IN_THE_WAY or shared(body, [other]) >= IN_THE_WAY


def in_front_first(bodies: Sequence[Landmarks], steps: Sequence[float]) -> list[int]:
    """Rows of the bodies: the best seen first, but of several answers about one person first the
    one that moved least (`steps`), because the others are about somebody else."""
    copies = [
        sum(
            steps[other] < steps[row] and is_duplicate(bodies[row], [bodies[other]])
            for other in range(len(bodies))
            if other != row
        )
        for row in range(len(bodies))
    ]
    return sorted(range(len(bodies)), key=lambda row: (copies[row], -quality(bodies[row])))


def step(body: Landmarks, last: Landmarks) -> float:
    """How far the joints moved from one frame to the next: the median, in sizes of the body."""
    moved = np.linalg.norm(body.xy_px[LIMBS] - last.xy_px[LIMBS], axis=1)
    return float(np.median(moved)) / size_of(last)


def size_of(body: Landmarks) -> float:
    """Diagonal of the box of a body's joints in pixels, at least 1."""
    return max(1.0, float(np.hypot(*np.ptp(body.xy_px, axis=0))))


def corners_of(body: Landmarks) -> np.ndarray:
    """Corners (2, 2) of the box of a body's joints."""
    return np.stack([body.xy_px.min(axis=0), body.xy_px.max(axis=0)])
