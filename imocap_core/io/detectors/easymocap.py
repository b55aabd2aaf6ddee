"""EasyMocap: a folder ``annots/CAMERA`` with one JSON file a frame.

Each file has ``annots``, a list of people with ``keypoints`` [[x, y, confidence], ...] (BODY_25
unless another model was chosen); boxes, ids, hands and faces are not used.
"""

from __future__ import annotations

from pathlib import Path

from imocap_core.io.detectors.frame_files import numbered_contents
from imocap_core.io.detectors.people import (
    DetectedPeople,
    detections,
    must_have_layout,
    points,
    type_name,
)

LAYOUTS = ("body25", "coco17", "halpe26", "wholebody133")


def read_easymocap(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, field, expected and got."""
    must_have_layout(LAYOUTS, layout, "EasyMocap", path)
    if not path.is_dir():
        raise ValueError(f"{path}: expected EasyMocap's folder annots/CAMERA, with a file a frame")
    people = {}
    for number, content, where in numbered_contents(path, "EasyMocap"):
        listed = content.get("annots") if isinstance(content, dict) else None
        if not isinstance(listed, list):
            raise ValueError(f"{where}: annots: expected a list of people, got {type_name(listed)}")
        people[number] = [
            points(
                person.get("keypoints") if isinstance(person, dict) else None,
                layout,
                f"{where}: annots[{n}].keypoints",
            )
            for n, person in enumerate(listed)
        ]
    return detections(people, layout, path)
