"""OpenPose: a folder with one JSON file a frame, each with any number of people."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

POINTS = {"body25": 25, "body25b": 25, "coco18": 18}  # points of each layout OpenPose writes,
POINTS |= {"coco17": 17, "halpe26": 26, "wholebody133": 133}  # and other tools in its form
_FAULTS_SHOWN = 5


@dataclass(frozen=True)
class DetectedPeople:
    """``people[i]`` (P, K, 3) are x, y (pixels) and confidence of the people of ``frames[i]``.

    ``frames`` (N,) are increasing source frame numbers. A point that was not found is NaN with
    confidence 0.
    """

    frames: NDArray[np.int64]
    people: tuple[NDArray[np.float64], ...]


def read_openpose(folder: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names the file, the field, what is wrong.

    The frame number is the last number in a file's name (``clip_000000000012_keypoints.json`` and
    ``clip.0012.json`` are frame 12); a frame without a file is a frame without people.
    """
    if layout not in POINTS:
        known = ", ".join(POINTS)
        raise ValueError(f"{folder}: OpenPose layouts are {known}, got {layout!r} in action.yaml")
    if not folder.is_dir():
        raise ValueError(
            f"{folder}: expected a folder with one OpenPose JSON file a frame, found none; "
            "check `keypoints` in action.yaml"
        )
    files = _numbered_files(folder)
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


def _numbered_files(folder: Path) -> dict[int, Path]:
    """Frame number -> file."""
    files: dict[int, Path] = {}
    for file in sorted(folder.glob("*.json")):
        numbers = re.findall(r"\d+", file.stem)
        if not numbers:
            raise ValueError(
                f"{file}: expected a frame number in the file name, got none; "
                "name the files like clip_000000000012_keypoints.json"
            )
        number = int(numbers[-1])
        if number in files:
            raise ValueError(
                f"{folder}: frame {number} has two files, {files[number].name} and {file.name}; "
                "keep one clip in a folder"
            )
        files[number] = file
    if not files:
        raise ValueError(f"{folder}: expected one OpenPose JSON file a frame, found no .json file")
    return files


def _read_frame(file: Path, layout: str) -> NDArray[np.float64]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{file}: is not JSON ({error}); run the detector again") from None
    found = content.get("people") if isinstance(content, dict) else None
    if not isinstance(found, list):
        raise ValueError(f"{file}: people: expected a list of people, got {_kind(found)}")
    bodies = [_read_person(file, i, person, layout) for i, person in enumerate(found)]
    present = [body for body in bodies if body is not None]
    return np.stack(present) if present else np.zeros((0, POINTS[layout], 3))


def _read_person(file: Path, i: int, person: Any, layout: str) -> NDArray[np.float64] | None:
    """(K, 3), or None for a person without a body (OpenPose then writes an empty list)."""
    where = f"{file}: people[{i}].pose_keypoints_2d"
    values = person.get("pose_keypoints_2d") if isinstance(person, dict) else None
    if not isinstance(values, list):
        raise ValueError(f"{where}: expected a list of numbers, got {_kind(values)}")
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


def _kind(value: Any) -> str:
    return "nothing" if value is None else type(value).__name__
