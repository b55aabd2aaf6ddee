"""Limbs as two networks tell them: their mean, and less visibility where they disagree.

The two are trained apart and err apart, where one network's answers to the same picture, mirrored
or cropped otherwise, err together.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .crops import MARGIN
from .landmarks import Landmarks
from .movenet import POINTS

ARMS, LEGS = [0, 1, 4, 5], [2, 3, 6, 7]  # among the joints below
JOINTS = [13, 15, 25, 27, 14, 16, 26, 28]  # elbow, wrist, knee, ankle: left, then right
SECOND_POINTS = [POINTS.index(joint) for joint in JOINTS]  # among the second network's
TIPS = {15: (17, 19, 21), 16: (18, 20, 22), 27: (29, 31), 28: (30, 32)}  # that go with a joint
# Shares of a body's size:
NEAR = 0.05  # distance within which the mean of both counts; beyond, the first network's place
DOUBTFUL = 0.08  # distance that halves the visibility
ELSEWHERE = 0.02  # median distance beyond which one of the two may look at a wrong place
SOMEBODY_ELSE = 0.15  # and beyond which the second network has another body
SWAPPED, APART = 0.6, 0.03  # of the distance, with sides exchanged; joints' mean distance


def is_doubted(body: Landmarks) -> bool:
    """Whether a second network has most limb joints elsewhere, or was not asked."""
    return body.second_xy_px is None or float(np.median(_distances(body)[1])) > ELSEWHERE


def combined(body: Landmarks) -> Landmarks:
    """The body, its limbs as both networks tell them."""
    if body.second_xy_px is None:
        return body
    second, away = _distances(body)
    if np.median(away) > SOMEBODY_ELSE:
        return body
    xy, visibility = body.xy_px.copy(), body.visibility.copy()
    share = 0.5 / (1 + (away / NEAR) ** 4)
    xy[JOINTS] += share[:, None] * (second - xy[JOINTS])
    for joint, trust in zip(JOINTS, 1 / (1 + (away / DOUBTFUL) ** 2), strict=True):
        visibility[[joint, *TIPS.get(joint, ())]] *= trust
    return replace(body, xy_px=xy, visibility=visibility)


def _distances(body: Landmarks) -> tuple[np.ndarray, np.ndarray]:
    """The second network's joints (8, 2), and how far they are from the body's, in its sizes."""
    assert body.second_xy_px is not None
    size, first = body.next_crop.side / MARGIN, body.xy_px[JOINTS]
    second = on_the_same_sides(first, body.second_xy_px[SECOND_POINTS], size)
    return second, np.linalg.norm(first - second, axis=1) / size


def on_the_same_sides(first: np.ndarray, second: np.ndarray, size: float) -> np.ndarray:
    """Joints (8, 2) of the second network, arms or legs with left and right exchanged where they
    are much nearer to the first's so: which side is which is judged later, over time."""
    sided = second.copy()
    for limb in (ARMS, LEGS):
        other_side = limb[2:] + limb[:2]
        away = np.linalg.norm(first[limb] - second[limb], axis=1).mean()
        exchanged = np.linalg.norm(first[limb] - second[other_side], axis=1).mean()
        if away > APART * size and exchanged < SWAPPED * away:
            sided[limb] = second[other_side]
    return sided
