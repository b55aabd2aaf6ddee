"""OpenPose: a folder with one JSON file per frame, each with any number of people."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.frame_files import numbered_files
from imocap_core.io.detectors.people import DetectedPeople, read_json, type_name

POINTS = {"body25": 25, "body25b": 25, "coco18": 18}  # points of each layout of OpenPose,
POINTS |= {"coco17": 17, "halpe26": 26, "wholebody133": 133}  # and of other tools in its format
_FAULTS_SHOWN = 5


def read_openpose(folder: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, field, expected and got.

    The frame number is the last number in a file's name (``clip_000000000012_keypoints.json`` and
    ``clip.0012.json`` are frame 12); a frame without a file is a frame without people.
    """
    if layout not in POINTS:
        layouts = ", ".join(POINTS)
        raise ValueError(f"{folder}: OpenPose layouts are {layouts}, got {layout!r} in action.yaml")
    if not folder.is_dir():
        raise ValueError(
            f"{folder}: expected a folder with one OpenPose JSON file per frame, found none; "
            "check `keypoints` in action.yaml"
        )
    files = numbered_files(folder)
    people, faults = {}, []
    for number, file in sorted(files.items()):
        try:
            people[number] = _read_frame(file, layout)
        except ValueError as fault:
            faults.append(str(fault))
    if faults:
        more = len(faults) - _FAULTS_SHOWN
        shown = faults[:_FAULTS_SHOWN] + ([f"and {more} more such files"] if more > 0 else [])
        raise ValueError("\n".join(shown))
    return DetectedPeople(np.array(sorted(people), dtype=np.int64), tuple(people.values()))


def _read_frame(file: Path, layout: str) -> Float[np.ndarray, "P K 3"]:
    content = read_json(file)
    people = content.get("people") if isinstance(content, dict) else None
    if not isinstance(people, list):
        raise ValueError(f"{file}: people: expected a list of people, got {type_name(people)}")
    bodies = [_read_person(file, i, person, layout) for i, person in enumerate(people)]
    present = [body for body in bodies if body is not None]
    return np.stack(present) if present else np.zeros((0, POINTS[layout], 3))


def _read_person(file: Path, i: int, person: Any, layout: str) -> Float[np.ndarray, "K 3"] | None:
    """The points, or None for a person without a body (OpenPose then writes an empty list)."""
    where = f"{file}: people[{i}].pose_keypoints_2d"
    values = person.get("pose_keypoints_2d") if isinstance(person, dict) else None
    if not isinstance(values, list):
        raise ValueError(f"{where}: expected a list of numbers, got {type_name(values)}")
    if not values:
        return None
    expected = 3 * POINTS[layout]
    if len(values) != expected:
        fitting = " or ".join(name for name, k in POINTS.items() if 3 * k == len(values))
        advice = f"set layout: {fitting} in action.yaml" if fitting else "check the detector"
        raise ValueError(
            f"{where}: expected {expected} numbers (x, y, confidence of the {POINTS[layout]} "
            f"points of {layout}), got {len(values)}; {advice}"
        )
    try:
        body = np.array(values, dtype=np.float64).reshape(-1, 3)
    except (TypeError, ValueError):
        raise ValueError(f"{where}: expected numbers only, got {values!r:.60}") from None
    missing = ~np.isfinite(body).all(axis=1) | (body[:, 2] <= 0)
    body[missing] = (np.nan, np.nan, 0.0)
    return body
