"""AlphaPose: `alphapose-results.json`, one list per clip with one entry per person and frame.

As AlphaPose documents it: ``image_id`` is the picture's name (``12.jpg`` of a video is frame 12),
``category_id`` 1, ``keypoints`` x, y (pixels) and confidence of every point, and ``score`` of the
person; newer versions add ``box`` and ``idx``. Models of COCO have 17 points, of Halpe 26 or 136,
of COCO-WholeBody 133. Confidences of heat maps may exceed 1 and then count as 1. The person's
score, box and track are not used: people are tracked by their joints.

Its other forms (``--format cmu`` and ``open``) are a dictionary by picture name with ``bodies``
(``joints``) or ``people`` (``pose_keypoints_2d``) of 18 points, and the same as a folder
``sep-json`` with one file a picture.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from imocap_core.io.detectors.coco import LAYOUTS, read_entries
from imocap_core.io.detectors.frame_files import numbered_contents
from imocap_core.io.detectors.people import (
    DetectedPeople,
    detections,
    flat_points,
    frame_number,
    must_have_layout,
    read_json,
    short,
    type_name,
)

PERSON_FIELDS = {"bodies": "joints", "people": "pose_keypoints_2d"}


def read_alphapose(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames in a results file, or a folder of them.

    ValueError names file, field, expected and got.
    """
    if path.is_dir():
        return _by_picture(numbered_contents(path, "AlphaPose"), layout, path)
    content = read_json(path)
    if not isinstance(content, dict) or "annotations" in content:
        return read_entries(path, layout, "AlphaPose")
    frames = (
        (frame_number(name, f"{path}: {short(name)}"), of_frame, f"{path}: {short(name)}")
        for name, of_frame in content.items()
    )
    return _by_picture(frames, layout, path)


def _by_picture(frames: Iterable[tuple[int, Any, str]], layout: str, path: Path) -> DetectedPeople:
    must_have_layout(LAYOUTS, layout, "AlphaPose", path)
    people = {}
    for frame, content, where in frames:
        name = next((n for n in PERSON_FIELDS if isinstance(content, dict) and n in content), None)
        listed = content[name] if name is not None else None
        if name is None or not isinstance(listed, list):
            raise ValueError(f"{where}: expected `bodies` or `people`, got {type_name(listed)}")
        people[frame] = [
            flat_points(
                person.get(PERSON_FIELDS[name]) if isinstance(person, dict) else person,
                layout,
                f"{where}.{name}[{n}]",
            )
            for n, person in enumerate(listed)
        ]
    return detections(people, layout, path)
