"""The networks of the detector `blazepose` on pictures in which the place of the person is known.

Answers: `limbs`, of elbows, wrists, knees and ankles the places [x, y] (pixels) at which the joint
of one of both sides may be, by both networks and by the second one's highest heat; `body`, 33 of
[x, y, visibility], as the detector has it; `presence`, the probability of a person. Settings: those
of blazepose_pose, and `places`, a file of the points (pictures, 33, 2) that the person is expected
to have, pixels, in the order of the pictures.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

KINDS = ((13, 14), (15, 16), (25, 26), (27, 28))  # elbows, wrists, knees, ankles: left, right
HIPS, SHOULDERS = [23, 24], [11, 12]
RIM = 1.02  # of the distance from the hips to the farthest point: the circle about the whole body


def known_person(settings: dict[str, Any]) -> Callable[[Any, bool], dict[str, Any]]:
    """The person at the next place, as a function of the next picture."""
    numpy = importlib.import_module("numpy")
    landmarks, movenet, both, crops, pyramid = (
        importlib.import_module(f"blazepose.{name}")
        for name in ("landmarks", "movenet", "both", "crops", "pyramid")
    )
    pose = importlib.import_module("blazepose_pose")
    first = pose.network(model_path=settings["landmark_model"])
    second = pose.second_network(settings) if settings["second_network"] else None
    places = iter(numpy.load(settings["places"]))

    def detect(picture: Any, is_last: bool) -> dict[str, Any]:
        sizes, place = pyramid.Pyramid(picture), next(places)
        hips = place[HIPS].mean(axis=0)
        up = place[SHOULDERS].mean(axis=0) - hips
        reach = RIM * numpy.linalg.norm(place - hips, axis=1).max()
        rim = hips + reach * up / max(numpy.linalg.norm(up), 1e-6)
        body = landmarks.detect_landmarks(sizes, crops.about(hips, rim), first)
        limbs = [[body.xy_px[k].tolist() for k in kind] for kind in KINDS]
        if second is not None:
            crop = movenet.crop_about(replace(body, xy_px=place))
            outputs = movenet.seen_in(sizes, crop, second)
            body = replace(body, second_xy_px=movenet.points_of(outputs, crop))
            peaks = movenet.peaks_of(outputs, crop)
            for places_of_kind, kind in zip(limbs, KINDS, strict=True):
                for point in map(movenet.POINTS.index, kind):
                    places_of_kind.append(body.second_xy_px[point].tolist())
                    places_of_kind += peaks[point].tolist()
        body = both.combined(body)
        rows = numpy.column_stack([body.xy_px, body.visibility])
        return {"limbs": limbs, "body": rows.tolist(), "presence": body.presence}

    return detect


if __name__ == "__main__":
    raise SystemExit(importlib.import_module("exchange").serve(known_person))
