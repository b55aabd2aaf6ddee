"""BlazePose on the pictures of one video, in order: a person detector and a landmark network.

With a second network, MoveNet, that looks at the limbs too.

Answers: `people`, each with `pose_landmarks`, `pose_world_landmarks` (33 of [x, y, z, visibility]);
`earlier`: people in former pictures, each also with `ago`, the number of frames: those who were
overlooked, and those of a picture that waited for this one. Settings: the
networks' files, and those of `blazepose.course`.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

MOST_THREADS = 4  # more hardly help one picture at a time


def people_detector(settings: dict[str, Any]) -> Callable[[Any, bool], dict[str, Any]]:
    """The courses of everybody through the pictures, as a function of the next."""
    course = importlib.import_module("blazepose.course").Course(
        network(model_path=settings["box_model"]),
        network(model_path=settings["person_model"]),
        network(model_path=settings["landmark_model"]),
        settings["min_person_confidence"],
        settings["min_tracking_confidence"],
        settings["most_people"],
        second=second_network(settings) if settings["second_network"] else None,
        every_picture=settings["every_picture"],
    )

    def detect(picture: Any, is_last: bool) -> dict[str, Any]:
        height, width = picture.shape[:2]
        people, earlier = course.next_people(picture, is_last)
        return {
            "people": [_landmarks(body, width, height) for body in people],
            "earlier": [{"ago": ago} | _landmarks(body, width, height) for ago, body in earlier],
        }

    return detect


def second_network(settings: dict[str, Any]) -> Any:
    """MoveNet, of TensorFlow.js's files."""
    movenet = importlib.import_module("blazepose.movenet")
    graph, weights = (Path(settings[name]) for name in ("second_graph", "second_weights"))
    translate = importlib.import_module("blazepose.tfjs").litert_model
    return network(model_content=translate(graph, weights, movenet.OUTPUTS, movenet.SIZE))


def network(**model: Any) -> Any:
    """The network in a file (model_path) or in memory (model_content), as a function of one
    picture."""
    threads = int(os.environ.get("OMP_NUM_THREADS") or min(os.cpu_count() or 1, MOST_THREADS))
    kind = importlib.import_module("ai_edge_litert.interpreter").Interpreter
    interpreter = kind(**model, num_threads=threads)
    interpreter.allocate_tensors()
    given = interpreter.get_input_details()[0]["index"]
    results = [tensor["index"] for tensor in interpreter.get_output_details()]

    def answer(picture: Any) -> list[Any]:
        interpreter.set_tensor(given, picture[None])
        interpreter.invoke()
        return [interpreter.get_tensor(result)[0] for result in results]

    return answer


def _landmarks(body: Any, width: int, height: int) -> dict[str, Any]:
    """One person: shares of the picture's sides (z: of its width), and metres."""
    xy, z, world = body.xy_px.tolist(), body.z_px.tolist(), body.world_m.tolist()
    visibility = body.visibility.tolist()
    picture = [
        [x / width, y / height, depth / width, share]
        for (x, y), depth, share in zip(xy, z, visibility, strict=True)
    ]
    metres = [[*xyz, share] for xyz, share in zip(world, visibility, strict=True)]
    return {"pose_landmarks": _rounded(picture), "pose_world_landmarks": _rounded(metres)}


def _rounded(rows: list[list[float]]) -> list[list[float]]:
    return [[round(value, 6) for value in row] for row in rows]


if __name__ == "__main__":
    raise SystemExit(importlib.import_module("exchange").serve(people_detector))
