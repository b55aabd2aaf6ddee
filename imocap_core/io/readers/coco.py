"""Keypoints of people by frame: COCO's results, AlphaPose, MMPose, Ultralytics.

docs/formats.md names the files and the fields that are used. Confidences of heat maps may exceed 1
and then count as 1; an annotation's visibility (0 not labelled, 1 hidden, 2 visible) as 0, 1 and 1.

AlphaPose's other forms (``--format cmu`` and ``open``) are a dictionary by picture name with
``bodies`` (``joints``) or ``people`` (``pose_keypoints_2d``) of 18 points, and the same as a folder
``sep-json`` with one file a picture.

MMPose's demos count frames from 1, its inferencer from 0: a list that starts at frame 1 and skips
none counts from 1. What the inferencer returns, saved as it is, is a list of frames that are lists
of people, or a ``predictions`` or a list of one such list; of a folder of pictures, one such list a
file.

Ultralytics' JSON has one entry a frame, a list of people (or its text) with ``keypoints`` {x, y,
visible}, pixels or shares of the picture. Its labels are a folder with a file a frame that has
people, ``NAME_1.txt`` of the first frame of a video; each row is a class, a box and x, y
(, confidence) of the points as shares, then possibly a confidence and a track.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.io.readers.people import (
    DetectedPeople,
    cleaned,
    detections,
    flat_points,
    frame_number,
    listed,
    must_have_layout,
    numbered_contents,
    numbered_files,
    points,
    read_json,
    short,
    type_name,
)
from imocap_core.limits import must_be_small_enough

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
    entries = listed(
        entries, path, f"{what}'s list of results", "name the file with the whole clip"
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
        of_frame = content[name] if name is not None else None
        if name is None or not isinstance(of_frame, list):
            raise ValueError(f"{where}: expected `bodies` or `people`, got {type_name(of_frame)}")
        people[frame] = [
            flat_points(
                person.get(PERSON_FIELDS[name]) if isinstance(person, dict) else person,
                layout,
                f"{where}.{name}[{n}]",
            )
            for n, person in enumerate(of_frame)
        ]
    return detections(people, layout, path)


MMPOSE_LAYOUTS = ("coco17", "halpe26", "wholebody133", "h36m17", "body25", "coco18")


def read_mmpose(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames of a predictions file. ValueError names file, field,
    expected and got."""
    must_have_layout(MMPOSE_LAYOUTS, layout, "MMPose", path)
    if path.is_dir():
        contents = numbered_contents(path, "MMPose")
        entries: list[Any] = [{"frame_id": n, "instances": people} for n, people, _ in contents]
    else:
        entries = frames_of(read_json(path), path)
    people: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for i, entry in enumerate(entries):
        where = f"{path}: [{i}]"
        entry = people_of(entry)
        entry = {"instances": entry} if isinstance(entry, list) else entry
        instances = entry.get("instances") if isinstance(entry, dict) else None
        instances = listed(instances, f"{where}.instances", "a list of people")
        frame = frame_number(entry.get("frame_id", i), f"{where}.frame_id")
        people[frame] = people.get(frame, []) + [
            _person(person, layout, f"{where}.instances[{n}]") for n, person in enumerate(instances)
        ]
    if not path.is_dir() and sorted(people) == list(range(1, len(people) + 1)):
        people = {frame - 1: in_frame for frame, in_frame in people.items()}
    return detections(people, layout, path)


def frames_of(content: Any, path: Path) -> list[Any]:
    """The list of frames, in either form. ValueError when there is none."""
    frames = content.get("instance_info") if isinstance(content, dict) else content
    what, advice = "a list with one entry per frame", "save the predictions of the whole video"
    return listed(frames, f"{path}: instance_info", what, advice)


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


ULTRALYTICS_LAYOUTS = ("coco17", "halpe26", "wholebody133")
BEFORE, AFTER = 5, 2  # numbers in a row before the points, and at most after them


def read_ultralytics(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames. ValueError names file, field, expected and got."""
    must_have_layout(ULTRALYTICS_LAYOUTS, layout, "Ultralytics", path)
    return detections(_labels(path, layout) if path.is_dir() else _json(path, layout), layout, path)


def people_of(entry: Any) -> Any:
    """The people of a frame, whose entry may be text, one person, a list of their list, or a
    dictionary of somebody's own with one list."""
    if isinstance(entry, str):
        try:
            return json.loads(entry)
        except (ValueError, RecursionError):
            return None
    if isinstance(entry, dict) and "keypoints" in entry:
        return [entry]
    if isinstance(entry, dict) and "instances" not in entry:
        lists = [value for value in entry.values() if isinstance(value, list)]
        entry = entry.get("predictions", lists[0] if len(lists) == 1 else entry)
    nested = isinstance(entry, list) and len(entry) == 1 and isinstance(entry[0], list)
    return entry[0] if nested else entry


def is_person(entry: Any) -> bool:
    """Whether an entry is a person of such a file."""
    points = entry.get("keypoints") if isinstance(entry, dict) else None
    return isinstance(points, dict) and {"x", "y"} <= set(points)


def _json(path: Path, layout: str) -> dict[int, list[Float[np.ndarray, "K 3"]]]:
    content = read_json(path)
    if isinstance(content, dict):
        content = content.get("frames", content)
    people: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for i, entry in enumerate(listed(content, path, "a list with one entry a frame")):
        in_frame, where = people_of(entry), f"{path}: [{i}]"
        if not isinstance(in_frame, list):
            raise ValueError(f"{where}: expected a list of people, got {short(entry)}")
        people.setdefault(_number(entry, i, where), []).extend(
            _ultralytics_person(person, layout, f"{where}[{n}].keypoints")
            for n, person in enumerate(in_frame)
        )
    return people


NUMBERS = ("frame", "frame_id", "frame_idx", "frame_index", "frame_number", "image_id")


def _number(entry: Any, place: int, where: str) -> int:
    """The frame number that an entry of somebody's own has, else its place."""
    name = next((n for n in NUMBERS if isinstance(entry, dict) and n in entry), None)
    return place if name is None else frame_number(entry[name], f"{where}.{name}")


def _ultralytics_person(person: Any, layout: str, where: str) -> Float[np.ndarray, "K 3"]:
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
    people: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for n, file in files.items():
        people[n - first] = []
        for row, where in rows_of(file):
            person = points_in(row, count)
            if person is None:
                raise ValueError(
                    f"{where}: expected a class, a box and {count} points, got {len(row)} numbers; "
                    f"run a pose model, and check `layout` in action.yaml"
                )
            people[n - first].append(person)
    return people


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
