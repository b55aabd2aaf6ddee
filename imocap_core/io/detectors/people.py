"""What the readers of 2D keypoints share: JSON, frame numbers, people checked at the door."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.openpose import DetectedPeople

Array = NDArray[np.float64]
# What a number of points means, in the formats of one list of points a person.
LAYOUT_OF_COUNT = {
    17: "coco17",
    18: "coco18",
    25: "body25",
    26: "halpe26",
    33: "mediapipe33",
    133: "wholebody133",
    136: "halpe136",
}

LAST_FRAME = 10_000_000
LARGEST = 1e7  # pixels: no picture is larger, and squares of them stay numbers


def read_json(path: Path) -> Any:
    """A JSON file. ValueError says when it is missing or is none."""
    must_be_file(path)
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path}: is not JSON ({error}); run the detector again") from None


def must_be_file(path: Path, field: str = "keypoints") -> None:
    """ValueError when there is none at the path."""
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise ValueError(
            f"{path}: expected a file, found {found}; correct `{field}` in action.yaml"
        )


def kind(value: Any) -> str:
    """What something is, for a sentence that says what was found instead."""
    return "nothing" if value is None else type(value).__name__


def short(value: Any) -> str:
    """The beginning of what something is, in one line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."


def frame_number(value: Any, where: str) -> int:
    """A frame number given as such, or the last number in a picture's name."""
    number = -1
    if isinstance(value, (int, float)) and not isinstance(value, bool) and value == value // 1:
        number = int(value)
    elif isinstance(value, str) and (digits := re.findall(r"\d+", Path(value).stem)):
        number = int(digits[-1]) if len(digits[-1]) < 30 else -1
    if not 0 <= number <= LAST_FRAME:
        raise ValueError(
            f"{where}: expected a frame number or a picture's name with one, got {short(value)}; "
            "name the pictures by their frame numbers"
        )
    return number


def flat_points(values: Any, layout: str, where: str) -> Array:
    """(K, 3) of a list x, y, confidence, x, y, confidence, ..., as the layout has them."""
    if not isinstance(values, list):
        raise ValueError(f"{where}: expected a list of numbers, got {kind(values)}")
    return points(_numbers(values, where).reshape(-1, 1), layout, where, flat=True)


def points(values: Any, layout: str, where: str, *, flat: bool = False) -> Array:
    """(K, 3) of a table of points (K, 3); a point that was not found is NaN with confidence 0.

    flat: the table's entries are one column. Confidences above 1 count as 1.
    """
    count = len(layout_names(layout))
    found = _numbers(values, where)
    if flat and found.size == 3 * count:
        found = found.reshape(count, 3)
    if found.shape != (count, 3):
        named = LAYOUT_OF_COUNT.get(found.size // 3 if flat else len(found))
        size = f"{found.size} numbers" if flat else f"{found.shape}"
        wanted = f"{3 * count} numbers" if flat else f"({count}, 3)"
        advice = f"set layout: {named}" if named not in (None, layout) else "check `layout`"
        raise ValueError(
            f"{where}: expected {wanted} (x, y, confidence of the {count} points of {layout}), "
            f"got {size}; {advice} in action.yaml"
        )
    return cleaned(found)


def cleaned(people: Array) -> Array:
    """Points (..., 3) whose missing ones are NaN with confidence 0, confidences at most 1."""
    people = np.array(people, dtype=np.float64)
    missing = ~(np.abs(people) < LARGEST).all(axis=-1) | ~(people[..., 2] > 0)
    people[..., 2] = np.minimum(people[..., 2], 1.0)
    people[missing] = (np.nan, np.nan, 0.0)
    return people


def _numbers(values: Any, where: str) -> Array:
    """Numbers of any shape; JSON's null is NaN."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{where}: expected numbers only, got {short(values)}") from None


def detections(
    people: Mapping[int, Sequence[Array]], layout: str, path: Path, frames: Iterable[int] = ()
) -> DetectedPeople:
    """DetectedPeople of frame number -> people (K, 3), and of `frames` that hold nobody.

    ValueError when nobody is in any frame.
    """
    if not any(len(found) for found in people.values()):
        raise ValueError(f"{path}: expected at least one person, got none; check the detector")
    nobody = np.zeros((0, len(layout_names(layout)), 3))
    numbers = sorted({*people, *frames})
    return DetectedPeople(
        np.array(numbers, dtype=np.int64),
        tuple(np.stack(people[n]) if people.get(n) else nobody for n in numbers),
    )


def must_be_known(layout: str, known: Sequence[str], what: str, path: Path) -> None:
    """ValueError unless the layout is one that the format has."""
    if layout not in known:
        raise ValueError(
            f"{path}: layout: expected one that {what} has ({', '.join(known)}), got {layout!r}; "
            "correct `layout` in action.yaml"
        )
