"""SAM 3D Body as a detector: the 70 points of every person in the picture, hands and feet too.

``pred_keypoints_2d`` (70, 2) pixels, of the files of `sam3d_files`. They become COCO-WholeBody's
points, without those of the face. The estimator gives no confidences: all points count as certain,
hidden ones too.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.people import DetectedPeople, cleaned, detections, must_have_layout
from imocap_core.io.estimators.estimates import field
from imocap_core.io.sam3d_files import NAMES, POINTS_2D, saved_people

LAYOUT = "wholebody133"
LOOKED_AT = 60  # entries
_ROOTS = {"left_hand_root": "left_wrist", "right_hand_root": "right_wrist"}


def read_sam3d_keypoints(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, frame, field, expected and got."""
    must_have_layout((LAYOUT,), layout, "SAM 3D Body", path)
    frames: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for frame, people in saved_people(path):
        points = [field(person, POINTS_2D, (len(NAMES), 2), where) for person, where in people]
        frames.setdefault(frame, []).extend(map(whole_body, points))
    return detections(frames, layout, path)


def is_sam3d(content: Any) -> bool:
    """Whether the beginning of a file's content has people of this kind."""
    for entry in content[:LOOKED_AT] if isinstance(content, list) else []:
        people = entry.get("people", [entry]) if isinstance(entry, dict) else entry
        if isinstance(people, list) and any(isinstance(p, dict) and POINTS_2D in p for p in people):
            return True
    return False


def whole_body(points_px: Float[np.ndarray, "70 2"]) -> Float[np.ndarray, "133 3"]:
    """One person's points as COCO-WholeBody's: pixels and confidence."""
    index = {name: k for k, name in enumerate(NAMES)}
    person = np.full((len(layout_names(LAYOUT)), 3), np.nan)
    for column, name in enumerate(layout_names(LAYOUT)):
        place = index.get(_ROOTS.get(name, name))
        if place is not None:
            person[column] = *points_px[place], 1.0
    return cleaned(person)
