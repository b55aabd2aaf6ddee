"""RTMPose by rtmlib on the pictures of one video: all people of each picture by itself.

Answers: `keypoints` (people of [x, y] pixels), `scores` (people of numbers).
"""

from __future__ import annotations

import importlib
import json
import os
import struct
import sys
from typing import Any, BinaryIO, TextIO

HEAD = struct.Struct("<III")


def main() -> int:
    """Read pictures, write people; 1 after writing a fault."""
    settings = json.loads(sys.argv[1])
    pictures = sys.stdin.buffer
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # rtmlib prints the models it loads
    try:
        numpy = importlib.import_module("numpy")
        model = _model(importlib.import_module("rtmlib"), settings)
    except Exception as error:
        _answer(answers, {"fault": f"{type(error).__name__}: {error}"})
        return 1
    _answer(answers, {"ready": True})
    _answer_all(pictures, answers, model, numpy)
    return 0


def _model(rtmlib: Any, settings: dict[str, Any]) -> Any:
    """Body with feet, or the whole body; with the given models, or those that rtmlib downloads."""
    kind = rtmlib.Wholebody if settings["hands"] else rtmlib.BodyWithFeet
    model = kind(
        det=settings["person_model"],
        pose=settings["pose_model"],
        mode=settings["mode"],
        backend="onnxruntime",
        device="cpu",
    )
    for part, given, turned in (
        (model.det_model, settings["person_model"], False),
        (model.pose_model, settings["pose_model"], True),
    ):
        shape = part.session.get_inputs()[0].shape[2:]  # height, width; strings where they are free
        if given is not None and all(isinstance(side, int) for side in shape):
            part.model_input_size = tuple(reversed(shape)) if turned else tuple(shape)
    return model


def _answer_all(pictures: BinaryIO, answers: TextIO, model: Any, numpy: Any) -> None:
    while len(head := pictures.read(HEAD.size)) == HEAD.size:
        _, height, width = HEAD.unpack(head)
        raw = pictures.read(3 * height * width)
        picture = numpy.frombuffer(raw, numpy.uint8).reshape(height, width, 3)[..., ::-1].copy()
        boxes = model.det_model(picture)
        keypoints, scores = numpy.zeros((0, 1, 2)), numpy.zeros((0, 1))
        if len(boxes):  # without one, rtmlib would take the whole picture for a person
            keypoints, scores = model.pose_model(picture, bboxes=boxes)
        _answer(
            answers, {"keypoints": keypoints.round(3).tolist(), "scores": scores.round(4).tolist()}
        )


def _answer(answers: TextIO, message: dict[str, Any]) -> None:
    answers.write(json.dumps(message) + "\n")
    answers.flush()


if __name__ == "__main__":
    raise SystemExit(main())
