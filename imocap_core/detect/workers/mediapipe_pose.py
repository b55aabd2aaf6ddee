"""MediaPipe Pose (or Holistic, with hands) on the pictures of one video, in order.

Answers: `pose_landmarks`, `pose_world_landmarks` (33 of [x, y, z, visibility]), with hands also
`left_hand_landmarks`, `right_hand_landmarks` (21 of [x, y, z]); null where nothing was detected.
"""

from __future__ import annotations

import importlib
import json
import os
import struct
import sys
from typing import Any, BinaryIO, TextIO

FIELDS = ("pose_landmarks", "pose_world_landmarks")
HANDS = ("left_hand_landmarks", "right_hand_landmarks")
HEAD = struct.Struct("<III")


def main() -> int:
    """Read pictures, write landmarks; 1 after writing a fault."""
    settings = json.loads(sys.argv[1])
    pictures = sys.stdin.buffer
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # so that no library prints into the answers
    try:
        numpy = importlib.import_module("numpy")
        solutions = importlib.import_module("mediapipe").solutions
        kind = solutions.holistic.Holistic if settings["hands"] else solutions.pose.Pose
        model = kind(
            static_image_mode=not settings["follow"],
            model_complexity=1,
            smooth_landmarks=True,
            min_detection_confidence=settings["min_detection_confidence"],
            min_tracking_confidence=settings["min_tracking_confidence"],
        )
    except Exception as error:
        _answer(answers, {"fault": f"{type(error).__name__}: {error}"})
        return 1
    with model:
        _answer(answers, {"ready": True})
        _answer_all(pictures, answers, model, numpy, (*FIELDS, *HANDS * settings["hands"]))
    return 0


def _answer_all(
    pictures: BinaryIO, answers: TextIO, model: Any, numpy: Any, fields: tuple[str, ...]
) -> None:
    while len(head := pictures.read(HEAD.size)) == HEAD.size:
        _, height, width = HEAD.unpack(head)
        raw = pictures.read(3 * height * width)
        picture = numpy.frombuffer(raw, numpy.uint8).reshape(height, width, 3)
        result = model.process(picture)
        _answer(answers, {name: _points(getattr(result, name), name) for name in fields})


def _points(landmarks: Any, name: str) -> list[list[float]] | None:
    if landmarks is None:
        return None
    rows = [[p.x, p.y, p.z] + [p.visibility] * (name not in HANDS) for p in landmarks.landmark]
    return [[round(value, 6) for value in row] for row in rows]


def _answer(answers: TextIO, message: dict[str, Any]) -> None:
    answers.write(json.dumps(message) + "\n")
    answers.flush()


if __name__ == "__main__":
    raise SystemExit(main())
