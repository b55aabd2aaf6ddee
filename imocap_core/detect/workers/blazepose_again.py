"""The networks of the detector `blazepose` on pictures in which the place of the person is known.

Answers: those of `blazepose.known_place.look_at`. Settings: those of blazepose_pose, and `places`,
a file of the points (pictures, 33, 2) that the person is expected to have, pixels, in the order of
the pictures.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any


def known_person(settings: dict[str, Any]) -> Callable[[Any, bool], dict[str, Any]]:
    """The person at the next place, as a function of the next picture."""
    pose = importlib.import_module("blazepose_pose")
    network = pose.network(model_path=settings["landmark_model"])
    second = pose.second_network(settings) if settings["second_network"] else None
    places = iter(importlib.import_module("numpy").load(settings["places"]))
    look_at = importlib.import_module("blazepose.looks").look_at
    pyramid = importlib.import_module("blazepose.landmarks").Pyramid

    def detect(picture: Any, is_last: bool) -> dict[str, Any]:
        answer: dict[str, Any] = look_at(pyramid(picture), next(places), network, second)
        return answer

    return detect


if __name__ == "__main__":
    raise SystemExit(importlib.import_module("exchange").serve(known_person))
