"""Ultralytics' pose models (YOLO): results saved as JSON, or the labels that ``save_txt`` writes.

JSON: a list with one entry a frame, what ``summary()`` or ``to_json()`` of its result gives: a list
of people (or its text) with ``keypoints`` {x, y, visible}, pixels or shares of the picture. Labels:
a folder with a file a frame that has people, ``NAME_1.txt`` of the first frame of a video; each
row is a class, a box and x, y (, confidence) of the points as shares, then possibly a confidence
and a track. Boxes and tracks are not used.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.frame_files import numbered_files
from imocap_core.io.detectors.people import (
    DetectedPeople,
    cleaned,
    detections,
    must_have_layout,
    read_json,
    short,
    type_name,
)
from imocap_core.limits import must_be_small_enough

LAYOUTS = ("coco17", "halpe26", "wholebody133")
BEFORE, AFTER = 5, 2  # numbers in a row before the points, and at most after them


def read_ultralytics(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, field, expected and got."""
    must_have_layout(LAYOUTS, layout, "Ultralytics", path)
    return detections(_labels(path, layout) if path.is_dir() else _json(path, layout), layout, path)


def people_of(entry: Any) -> Any:
    """The people of a frame, whose entry may be text."""
    if isinstance(entry, str):
        try:
            return json.loads(entry)
        except (ValueError, RecursionError):
            return None
    return entry


def is_person(entry: Any) -> bool:
    """Whether an entry is a person of such a file."""
    points = entry.get("keypoints") if isinstance(entry, dict) else None
    return isinstance(points, dict) and {"x", "y"} <= set(points)


def _json(path: Path, layout: str) -> dict[int, list[Float[np.ndarray, "K 3"]]]:
    listed = read_json(path)
    if not isinstance(listed, list):
        raise ValueError(f"{path}: expected a list with one entry a frame, got {type_name(listed)}")
    people = {}
    for frame, entry in enumerate(listed):
        in_frame = people_of(entry)
        if not isinstance(in_frame, list):
            raise ValueError(f"{path}: [{frame}]: expected a list of people, got {short(entry)}")
        people[frame] = [
            _person(person, layout, f"{path}: [{frame}][{n}].keypoints")
            for n, person in enumerate(in_frame)
        ]
    return people


def _person(person: Any, layout: str, where: str) -> Float[np.ndarray, "K 3"]:
    if not is_person(person):
        raise ValueError(f"{where}: expected x, y and visible of the points, got {short(person)}")
    points, count = person["keypoints"], len(layout_names(layout))
    try:
        columns = [np.array(points[name], float) for name in ("x", "y")]
        columns.append(np.array(points.get("visible", np.ones(count)), float))
        return cleaned(np.stack(columns, axis=-1).reshape(count, 3))
    except (TypeError, ValueError):
        raise ValueError(
            f"{where}: expected x, y and visible of the {count} points of {layout}, got "
            f"{short(points)}; check `layout` in action.yaml"
        ) from None


def _labels(folder: Path, layout: str) -> dict[int, list[Float[np.ndarray, "K 3"]]]:
    files = numbered_files(folder, ".txt", "Ultralytics")
    count = len(layout_names(layout))
    first = min(min(files), 1)  # of a video they count from 1
    return {n - first: [_row(r, count, where) for r, where in rows_of(f)] for n, f in files.items()}


def rows_of(file: Path) -> list[tuple[list[float], str]]:
    """The rows of numbers of a labels file, and where they are."""
    must_be_small_enough(file)
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
        rows = [[float(word) for word in line.split()] for line in lines]
    except ValueError as error:
        raise ValueError(f"{file}: expected rows of numbers: {error}") from None
    return [(row, f"{file}: row {n}") for n, row in enumerate(rows, start=1) if row]


def points_in(row: list[float], count: int) -> Float[np.ndarray, "K 3"] | None:
    """x, y, confidence of `count` points in a row; None where it has another number of them."""
    for width in (3, 2):
        after = len(row) - BEFORE - width * count
        if 0 <= after <= AFTER:
            table = np.array(row[BEFORE : BEFORE + width * count]).reshape(count, width)
            visible = table[:, 2] if width == 3 else (table != 0).any(axis=1)
            return cleaned(np.column_stack([table[:, :2], visible]))
    return None


def _row(row: list[float], count: int, where: str) -> Float[np.ndarray, "K 3"]:
    person = points_in(row, count)
    if person is None:
        raise ValueError(
            f"{where}: expected a class, a box and {count} points, got {len(row)} numbers; run a "
            f"pose model, and check `layout` in action.yaml"
        )
    return person
