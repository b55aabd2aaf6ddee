"""MMPose: the predictions of one clip as one JSON file.

Its demos write ``meta_info`` and ``instance_info``; its inferencer writes the list alone. The list
has one entry per frame: ``frame_id`` and ``instances``, each with ``keypoints`` [[x, y], ...] in
pixels and ``keypoint_scores``. The demos count frames from 1, the inferencer from 0: a list that
starts at frame 1 and skips none counts from 1. Boxes and their scores are not used.

What the inferencer returns, saved as it is, is a list of frames that are lists of people; of a
folder of pictures it writes one such list a file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.frame_files import numbered_contents
from imocap_core.io.detectors.people import (
    DetectedPeople,
    detections,
    frame_number,
    must_have_layout,
    points,
    read_json,
    short,
    type_name,
)

LAYOUTS = ("coco17", "halpe26", "wholebody133", "h36m17", "body25", "coco18")


def read_mmpose(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames of a predictions file. ValueError names file, field,
    expected and got."""
    must_have_layout(LAYOUTS, layout, "MMPose", path)
    if path.is_dir():
        contents = numbered_contents(path, "MMPose")
        listed: list[Any] = [{"frame_id": n, "instances": people} for n, people, _ in contents]
    else:
        listed = frames_of(read_json(path), path)
    people: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for i, entry in enumerate(listed):
        where = f"{path}: [{i}]"
        entry = {"instances": entry} if isinstance(entry, list) else entry
        instances = entry.get("instances") if isinstance(entry, dict) else None
        if not isinstance(instances, list):
            raise ValueError(
                f"{where}.instances: expected a list of people, got {type_name(instances)}"
            )
        frame = frame_number(entry.get("frame_id", i), f"{where}.frame_id")
        people[frame] = people.get(frame, []) + [
            _person(person, layout, f"{where}.instances[{n}]") for n, person in enumerate(instances)
        ]
    if not path.is_dir() and sorted(people) == list(range(1, len(people) + 1)):
        people = {frame - 1: in_frame for frame, in_frame in people.items()}
    return detections(people, layout, path)


def frames_of(content: Any, path: Path) -> list[Any]:
    """The list of frames, in either form. ValueError when there is none."""
    listed = content.get("instance_info") if isinstance(content, dict) else content
    if not isinstance(listed, list):
        raise ValueError(
            f"{path}: instance_info: expected a list with one entry per frame, got "
            f"{type_name(listed)}; save the predictions of the whole video"
        )
    return listed


def _person(person: Any, layout: str, where: str) -> Float[np.ndarray, "K 3"]:
    xy = person.get("keypoints") if isinstance(person, dict) else None
    scores = person.get("keypoint_scores") if isinstance(person, dict) else None
    if not isinstance(xy, list) or not isinstance(scores, list) or len(xy) != len(scores):
        got = f"{_size(xy)} and {_size(scores)}"
        raise ValueError(
            f"{where}: expected keypoints [[x, y], ...] and as many keypoint_scores, got {got}"
        )
    try:
        table = np.column_stack([np.array(xy, float).reshape(len(xy), -1)[:, :2], scores])
    except (TypeError, ValueError):
        raise ValueError(f"{where}.keypoints: expected numbers only, got {short(xy)}") from None
    return points(table, layout, f"{where}.keypoints")


def _size(values: Any) -> str:
    return f"{len(values)}" if isinstance(values, list) else type_name(values)
