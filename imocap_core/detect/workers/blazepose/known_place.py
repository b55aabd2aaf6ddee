"""A look at a person whose place in the picture is known, by both networks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .both import combined
from .crops import Crop, about
from .landmarks import detect_landmarks
from .movenet import POINTS, crop_about, peaks_of, points_of, seen_in
from .networks import Network
from .pyramid import Pyramid

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
