"""RTMPose by rtmlib on the pictures of one video: all people of each picture by itself.

Answers: `keypoints` (people of [x, y] pixels), `scores` (people of numbers).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any


def people_detector(settings: dict[str, Any]) -> Callable[[Any, bool], dict[str, Any]]:
    """RTMPose, as a function of one picture."""
    numpy = importlib.import_module("numpy")
    model = _model(importlib.import_module("rtmlib"), settings)

    def detect(picture: Any, _: bool) -> dict[str, Any]:
        bgr = picture[..., ::-1].copy()
        boxes = model.det_model(bgr)
        keypoints, scores = numpy.zeros((0, 1, 2)), numpy.zeros((0, 1))
        if len(boxes):  # without one, rtmlib would take the whole picture for a person
            keypoints, scores = model.pose_model(bgr, bboxes=boxes)
        return {"keypoints": keypoints.round(3).tolist(), "scores": scores.round(4).tolist()}

    return detect


def _model(rtmlib: Any, settings: dict[str, Any]) -> Any:
    """Body with feet, or the whole body; with the given models, or those that rtmlib downloads."""
    kind = rtmlib.Wholebody if settings["hands"] else rtmlib.BodyWithFeet
    model = kind(
        det=settings["person_model"],
        pose=settings["pose_model"],
        mode="balanced",
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


if __name__ == "__main__":
    raise SystemExit(importlib.import_module("exchange").serve(people_detector))
