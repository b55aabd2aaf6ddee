"""Results in COCO's form: one JSON list for a clip, one entry a person a frame.

Each entry has ``image_id`` (here the frame number, or a picture's name that ends in it),
``keypoints`` (x, y, score, x, y, score, ... of the detector's points, pixels) and a ``score`` of
the whole person, as COCO's page on result formats describes; whole-body results (COCO-WholeBody)
have ``foot_kpts``, ``face_kpts``, ``lefthand_kpts`` and ``righthand_kpts`` beside. An annotation
file's visibility flags (0 not labelled, 1 hidden, 2 visible) count as 0, 1 and 1. Category, box and
the person's score are not used: who is the performer is decided by where the joints are.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.io.detectors.openpose import DetectedPeople
from imocap_core.io.detectors.people import (
    detections,
    flat_points,
    frame_number,
    kind,
    must_be_known,
    read_json,
)

LAYOUTS = ("coco17", "halpe26", "body25", "coco18", "wholebody133", "halpe136")
WHOLE_BODY_PARTS = ("keypoints", "foot_kpts", "face_kpts", "lefthand_kpts", "righthand_kpts")


def read_coco(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames in a results file. ValueError names file, field, what is wrong."""
    return read_entries(path, layout, "COCO")


def read_entries(path: Path, layout: str, what: str) -> DetectedPeople:
    """As `read_coco`; `what` is the format's name in sentences."""
    must_be_known(layout, LAYOUTS, what, path)
    entries = read_json(path)
    if isinstance(entries, dict) and isinstance(entries.get("annotations"), list):
        entries = entries["annotations"]  # an annotation file
    if not isinstance(entries, list):
        raise ValueError(
            f"{path}: expected {what}'s list of results, got {kind(entries)}; name the file that "
            "holds the whole clip"
        )
    people: dict[int, list[np.ndarray]] = {}
    for i, entry in enumerate(entries):
        where = f"{path}: [{i}]"
        if not isinstance(entry, dict):
            raise ValueError(f"{where}: expected one person's fields, got {kind(entry)}")
        frame = frame_number(entry.get("image_id"), f"{where}.image_id")
        person = flat_points(_all_points(entry, layout), layout, f"{where}.keypoints")
        people.setdefault(frame, []).append(person)
    return detections(people, layout, path)


def _all_points(entry: dict[str, Any], layout: str) -> Any:
    """The person's numbers, those of a whole body together."""
    body = entry.get("keypoints")
    if layout != "wholebody133" or "foot_kpts" not in entry or not isinstance(body, list):
        return body
    parts = [entry.get(name) for name in WHOLE_BODY_PARTS]
    return [number for part in parts if isinstance(part, list) for number in part]
