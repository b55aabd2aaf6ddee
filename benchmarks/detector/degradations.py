"""Degraded footage: what a detector has to cope with, made from real pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

Picture = UInt8[np.ndarray, "height width 3"]
Limbs = Float[np.ndarray, "12 2"]  # shoulder, elbow, wrist, hip, knee, ankle; left, then right
LEGS = [3, 4, 5, 9, 10, 11]
BLUR_SHARE = 0.02  # of the picture's larger side
PASTED_BESIDE = 0.7  # widths of the person's box, by which the second one stands beside
MARGIN = 0.1  # of the person's height, about the box of the limbs
DROPPED = 0.5
MIDDLE_THIRD = 1 / 3  # of the clip: where it begins


@dataclass(frozen=True)
class Degradation:
    """One kind of degraded footage.

    picture: of a picture, the performer's limbs in it and the share of the clip that has passed.
    scale: sides of the degraded picture / the plain one's. dropped: share of the frames left out.
    """

    name: str
    title: str
    picture: Callable[[Picture, Limbs, float], Picture] | None = None
    scale: float = 1.0
    dropped: float = 0.0


def hidden_legs(
    picture: Picture, limbs: Limbs, passed: float, begin: float = MIDDLE_THIRD
) -> Picture:
    """A black box over the legs in the third of the clip that begins where the share `begin` has
    passed."""
    if not begin <= passed < begin + 1 / 3:
        return picture
    (x0, y0), (x1, y1) = box_about(limbs[LEGS], 0.5 * MARGIN * np.ptp(limbs[:, 1]))
    hidden = picture.copy()
    hidden[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = 0
    return hidden


def motion_blur(picture: Picture, limbs: Limbs, passed: float) -> Picture:
    """The mean of the picture moved to the side."""
    length = max(3, round(BLUR_SHARE * max(picture.shape[:2])))
    return np.asarray(cv2.blur(picture, (length, 1)), np.uint8)


def halved(picture: Picture, limbs: Limbs, passed: float) -> Picture:
    """Half the width and height."""
    half = (picture.shape[1] // 2, picture.shape[0] // 2)
    return np.asarray(cv2.resize(picture, half, interpolation=cv2.INTER_AREA), np.uint8)


def second_person(picture: Picture, limbs: Limbs, passed: float) -> Picture:
    """The performer's box, mirrored, pasted beside: on the side with more room."""
    height, width = picture.shape[:2]
    corners = np.array(box_about(limbs, MARGIN * np.ptp(limbs[:, 1])))
    (x0, y0), (x1, y1) = np.clip(corners, 0, (width, height))
    patch = picture[y0:y1, x0:x1][:, ::-1]
    by = round(PASTED_BESIDE * (x1 - x0)) * (1 if x0 + x1 < width else -1)
    first, last = max(x0 + by, 0), min(x1 + by, width)
    pasted = picture.copy()
    pasted[y0:y1, first:last] = patch[:, first - x0 - by : last - x0 - by]
    return pasted


def box_about(points: Float[np.ndarray, "N 2"], margin: float) -> list[tuple[int, int]]:
    """Upper left and lower right corner of points with a margin, whole pixels."""
    corners = (points.min(axis=0) - margin, points.max(axis=0) + margin)
    return [(round(float(x)), round(float(y))) for x, y in corners]


PLAIN = Degradation("plain", "as filmed")
DEGRADATIONS = (
    PLAIN,
    Degradation("legs", "legs hidden", hidden_legs),
    Degradation("blur", "blur", motion_blur),
    Degradation("half", "half the resolution", halved, scale=0.5),
    Degradation("second", "second person", second_person),
    Degradation("dropped", "frames dropped", dropped=DROPPED),
)
