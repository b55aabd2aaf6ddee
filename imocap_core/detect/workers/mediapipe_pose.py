"""MediaPipe Pose (or Holistic, with hands) on the pictures of one video, in order.

Answers: `pose_landmarks`, `pose_world_landmarks` (33 of [x, y, z, visibility]), with hands also
`left_hand_landmarks`, `right_hand_landmarks` (21 of [x, y, z]); null where nothing was detected.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

FIELDS = ("pose_landmarks", "pose_world_landmarks")
HANDS = ("left_hand_landmarks", "right_hand_landmarks")


def landmark_detector(settings: dict[str, Any]) -> Callable[[Any, bool], dict[str, Any]]:
    """MediaPipe's model, as a function of one picture."""
    solutions = importlib.import_module("mediapipe").solutions
    kind = solutions.holistic.Holistic if settings["hands"] else solutions.pose.Pose
    model = kind(
        static_image_mode=True,
        model_complexity=1,
        min_detection_confidence=settings["min_detection_confidence"],
    )
    fields = (*FIELDS, *HANDS * settings["hands"])

    def detect(picture: Any, _: bool) -> dict[str, Any]:
        result = model.process(picture)
        return {name: _points(getattr(result, name), name) for name in fields}

    return detect


def _points(landmarks: Any, name: str) -> list[list[float]] | None:
    if landmarks is None:
        return None
    rows = [[p.x, p.y, p.z] + [p.visibility] * (name not in HANDS) for p in landmarks.landmark]
    return [[round(value, 6) for value in row] for row in rows]


if __name__ == "__main__":
    raise SystemExit(importlib.import_module("exchange").serve(landmark_detector))
