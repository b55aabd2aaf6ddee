"""COCO's results: one JSON list per clip with one entry per person and frame.

Each entry has ``image_id`` (here the frame number, or a picture's name that ends in it),
``keypoints`` (x, y, score, x, y, score, ... of the detector's points, pixels) and a ``score`` of
the whole person, as COCO's page on result formats describes; whole-body results (COCO-WholeBody)
add ``foot_kpts``, ``face_kpts``, ``lefthand_kpts`` and ``righthand_kpts``. An annotation
file's visibility flags (0 not labelled, 1 hidden, 2 visible) count as 0, 1 and 1. Category, box and
the person's score are not used: the performer is found by the joints' positions.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.io.detectors.people import (
    DetectedPeople,
    detections,
    flat_points,
    frame_number,
    must_have_layout,
    read_json,
    type_name,
)

LAYOUTS = ("coco17", "halpe26", "body25", "coco18", "wholebody133", "halpe136")
WHOLE_BODY_PARTS = ("keypoints", "foot_kpts", "face_kpts", "lefthand_kpts", "righthand_kpts")


def read_coco(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames in a results file.

    ValueError names file, field, expected and got.
    """
    return read_entries(path, layout, "COCO")


def read_entries(path: Path, layout: str, what: str) -> DetectedPeople:
    """As `read_coco`; `what` is the format's name in messages."""
    must_have_layout(LAYOUTS, layout, what, path)
    entries = read_json(path)
    if isinstance(entries, dict) and isinstance(entries.get("annotations"), list):
        entries = entries["annotations"]  # an annotation file
    if not isinstance(entries, list):
        raise ValueError(
            f"{path}: expected {what}'s list of results, got {type_name(entries)}; name the file "
            "with the whole clip"
        )
    people: dict[int, list[np.ndarray]] = {}
    for i, entry in enumerate(entries):
        where = f"{path}: [{i}]"
        if not isinstance(entry, dict):
            raise ValueError(f"{where}: expected one person's fields, got {type_name(entry)}")
        frame = frame_number(entry.get("image_id"), f"{where}.image_id")
        person = flat_points(_all_points(entry, layout), layout, f"{where}.keypoints")
        people.setdefault(frame, []).append(person)
    return detections(people, layout, path)


def _all_points(entry: dict[str, Any], layout: str) -> Any:
    """The person's numbers, all parts of a whole body concatenated."""
    body = entry.get("keypoints")
    if layout != "wholebody133" or "foot_kpts" not in entry or not isinstance(body, list):
        return body
    parts = [entry.get(name) for name in WHOLE_BODY_PARTS]
    return [number for part in parts if isinstance(part, list) for number in part]
