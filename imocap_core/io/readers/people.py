"""Shared by the readers of 2D keypoints: files a frame, people, points by name, all checked."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped

from imocap_core.body.layouts import layout_names
from imocap_core.limits import LAST_FRAME, must_be_small_enough


def frame_files(folder: Path, suffix: str = ".json") -> list[Path]:
    """Its files in the order of their names, without hidden ones (macOS writes ``._NAME``)."""
    files = (f for f in folder.glob("*") if f.suffix.lower() == suffix)
    return sorted(f for f in files if not f.name.startswith("."))


def numbered_files(folder: Path, suffix: str = ".json", what: str = "OpenPose") -> dict[int, Path]:
    """Frame number -> file; the number is the last one in the name that no two files share.
    ValueError where a name has none, a number has two files, or there is no file."""
    files: dict[int, Path] = {}
    numbers_in = {file: re.findall(r"\d+", file.stem) for file in frame_files(folder, suffix)}
    every, last = list(numbers_in.values()), 1  # which of the numbers, from the last one
    for place in range(1, min(map(len, every), default=0) + 1):  # 2 of clip_12_v2, clip_13_v2
        if len({int(numbers[-place]) for numbers in every}) == len(every):
            last = place
            break
    for file, numbers in numbers_in.items():
        if not numbers:
            raise ValueError(
                f"{file}: expected a frame number in the file name, got none; "
                f"name the files like clip_000000000012_keypoints{suffix}"
            )
        number = int(numbers[-last])
        if number in files:
            raise ValueError(
                f"{folder}: frame {number} has two files, {files[number].name} and {file.name}; "
                "keep one clip per folder"
            )
        files[number] = file
    if not files:
        raise ValueError(
            f"{folder}: expected one {what} file per frame, found no {suffix} file; check "
            f"`keypoints` in action.yaml"
        )
    return dict(sorted(files.items()))


# Layout by number of points, in formats with one list of points per person.
LAYOUT_OF_COUNT = {
    17: "coco17",
    18: "coco18",
    25: "body25",
    26: "halpe26",
    33: "mediapipe33",
    133: "wholebody133",
    136: "halpe136",
}

TABLES = (".csv", ".tsv")
JSON_LINES = (".jsonl", ".ndjson")
LARGEST = 1e7  # pixels: no picture is larger, and squares do not overflow


@dataclass(frozen=True)
class DetectedPeople:
    """All people of all frames: x, y (pixels) and confidence of the K points of each.

    frames: increasing source frame numbers. people: one array per frame. A missing point is NaN
    with confidence 0.
    """

    frames: Int[np.ndarray, " N"]
    people: tuple[Float[np.ndarray, "_ K 3"], ...]


def read_json(path: Path) -> Any:
    """The content of a JSON file, in UTF-8 or 16, with or without a mark at its beginning; of JSON
    lines, and of lists by frame number, their list. ValueError when it is missing or not JSON."""
    must_be_file(path)
    must_be_small_enough(path)
    try:
        text = path.read_bytes()
        text_of = text.decode(json.detect_encoding(text))
        lines = text_of.splitlines() if path.suffix.lower() in JSON_LINES else [text_of]
        contents = [json.loads(line, parse_int=_integer) for line in lines if line.strip()]
    except (ValueError, RecursionError) as error:  # ValueError: JSON's and UTF-8's
        raise ValueError(f"{path}: is not JSON ({error}); run the detector again") from None
    if not contents:
        raise ValueError(f"{path}: is empty; run the detector again")
    return contents if path.suffix.lower() in JSON_LINES else _in_order(contents[0])


def _in_order(content: Any) -> Any:
    """The list of frames for {"0": [...], "1": [...]}; numbers from 1 without a gap begin there."""
    if not isinstance(content, dict) or not all(
        key.isdecimal() and len(key) < 8 and isinstance(value, list)
        for key, value in content.items()
    ):
        return content
    frames = {int(key): value for key, value in content.items()}
    if not frames or max(frames) > LAST_FRAME:
        return content
    first = int(sorted(frames) == list(range(1, len(frames) + 1)))
    return [frames.get(n, []) for n in range(first, max(frames) + 1)]


def _integer(digits: str) -> int | float:
    """A number without a point; infinite, and so missing, where no float is as large."""
    return int(digits) if len(digits) < 300 else math.copysign(math.inf, -(digits[0] == "-"))


def must_be_file(path: Path, field: str = "keypoints") -> None:
    """ValueError unless the path is a file."""
    if not path.is_file():
        got = "a folder" if path.is_dir() else "no such file"
        raise ValueError(f"{path}: expected a file, found {got}; correct `{field}` in action.yaml")


UTF_16 = (b"\xff\xfe", b"\xfe\xff")
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
MISSING = ("", "none", "null", "na", "n/a")


def read_csv(path: Path) -> list[list[str]]:
    """The non-empty rows of a CSV file, also with semicolons or tabs and decimal commas, as
    spreadsheets write them. ValueError when it cannot be read or is empty."""
    must_be_file(path)
    try:
        content = path.read_bytes()
        text = content.decode("utf-16" if content.startswith(UTF_16) else "utf-8-sig")
        heading = text.partition("\n")[0]
        between = max(",;\t", key=heading.count)
        rows = [
            row
            for row in csv.reader(io.StringIO(text, newline=""), delimiter=between)
            if any(map(str.strip, row))
        ]
        if between != ",":
            rows = [
                [c.replace(",", ".") if DECIMAL_COMMA.fullmatch(c.strip()) else c for c in row]
                for row in rows
            ]
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is not a CSV file ({error}); export it again") from None
    if not rows:
        raise ValueError(f"{path}: expected a CSV file with headings, got an empty file")
    return rows


def must_be_whole(row: list[str], count: int, where: str) -> None:
    """ValueError unless a row has as many cells as the heading."""
    if len(row) != count:
        raise ValueError(f"{where}: expected {count} cells, got {len(row)}; the file is cut off?")


def cell_number(cell: str, where: str) -> float:
    """A cell as a number, NaN when it is empty or says so."""
    try:
        return float("nan") if cell.strip().lower() in MISSING else float(cell)
    except ValueError:
        raise ValueError(f"{where}: expected numbers only, got {short(cell)}") from None


def listed(value: Any, where: Path | str, what: str, advice: str = "") -> list[Any]:
    """The value, a list or an array as one. ValueError when it is neither; `what` was expected."""
    value = list(value) if isinstance(value, np.ndarray) and value.ndim else value
    if not isinstance(value, list):
        end = f"; {advice}" if advice else ""
        raise ValueError(f"{where}: expected {what}, got {type_name(value)}{end}")
    return value


def type_name(value: Any) -> str:
    """Name of a value's type, for messages."""
    return "nothing" if value is None else type(value).__name__


def short(value: Any) -> str:
    """The beginning of a value's representation, in one line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."


def frame_number(value: Any, where: str) -> int:
    """A frame number, or the last number in a picture's name. ValueError when there is none."""
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


def points(values: Any, layout: str, where: str, *, flat: bool = False) -> Float[np.ndarray, "K 3"]:
    """Points of a table (K, 3), or flat of a list x, y, confidence, x, y, confidence, ..., in the
    layout's order, cleaned (see `cleaned`).

    ValueError when the numbers do not fit the layout.
    """
    count = len(layout_names(layout))
    table = _numbers(listed(values, where, "a list of numbers") if flat else values, where)
    if flat and table.size == 3 * count:
        table = table.reshape(count, 3)
    if table.shape != (count, 3):
        fitting = LAYOUT_OF_COUNT.get(table.size // 3 if flat else len(np.atleast_1d(table)))
        size = f"{table.size} numbers" if flat else f"{table.shape}"
        expected = f"{3 * count} numbers" if flat else f"({count}, 3)"
        advice = f"set layout: {fitting}" if fitting not in (None, layout) else "check `layout`"
        raise ValueError(
            f"{where}: expected {expected} (x, y, confidence of the {count} points of {layout}), "
            f"got {size}; {advice} in action.yaml"
        )
    return cleaned(table)


def cleaned(people: Shaped[np.ndarray, "*any 3"]) -> Float[np.ndarray, "*any 3"]:
    """Points with missing ones as NaN with confidence 0, and confidences of at most 1.

    Missing: not finite, beyond `LARGEST`, at (0, 0), or of confidence 0 or less.
    """
    people = np.array(people, dtype=np.float64)
    missing = ~(np.abs(people) < LARGEST).all(axis=-1) | ~(people[..., 2] > 0)
    missing |= (people[..., :2] == 0).all(axis=-1)
    people[..., 2] = np.minimum(people[..., 2], 1.0)
    people[missing] = (np.nan, np.nan, 0.0)
    return people


def _numbers(values: Any, where: str) -> Float[np.ndarray, "..."]:
    """Numbers of any shape; JSON's null is NaN."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{where}: expected numbers only, got {short(values)}") from None


def detections(
    people: Mapping[int, Sequence[Float[np.ndarray, "K 3"]]],
    layout: str,
    path: Path,
    *,
    maybe_nobody: bool = False,
) -> DetectedPeople:
    """Detections of frame number -> people. ValueError when no frame has a person; or, where maybe
    nobody is there, without any frame."""
    if not (people if maybe_nobody else any(map(len, people.values()))):
        raise ValueError(f"{path}: expected at least one person, got none; check the detector")
    nobody = np.zeros((0, len(layout_names(layout)), 3))
    numbers = sorted(people)
    return DetectedPeople(
        np.array(numbers, dtype=np.int64),
        tuple(np.stack(people[n]) if people.get(n) else nobody for n in numbers),
    )


def must_have_layout(layouts: Sequence[str], layout: str, what: str, path: Path) -> None:
    """ValueError unless the layout is one that the format `what` has."""
    if layout not in layouts:
        raise ValueError(
            f"{path}: layout: expected one that {what} has ({', '.join(layouts)}), got {layout!r}; "
            "correct `layout` in action.yaml"
        )


LAYOUTS = ("coco17", "halpe26", "body25", "body25b", "coco18", "h36m17", "mediapipe33")
MIN_MATCHED = 4  # names of a layout; with fewer the layout stays unknown
_SIDES = {"l": "left", "lt": "left", "left": "left", "r": "right", "rt": "right", "right": "right"}
_SAME = {
    "bigtoe": "big_toe",
    "smalltoe": "small_toe",
    "littletoe": "small_toe",
    "little_toe": "small_toe",
    "toe": "big_toe",
    "foot_index": "big_toe",
    "headtop": "head_top",
    "top_head": "head_top",
    "top_of_head": "head_top",
    "vertex": "head_top",
    "midhip": "mid_hip",
    "hip_middle": "mid_hip",
    "pelvis": "mid_hip",
}


def plain_name(name: str) -> str:
    """left_knee for LeftKnee, L-knee, knee_l, "Left Knee"; other names in snake case."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name).lower()
    parts = [part for part in re.split(r"[^a-z0-9]+", words) if part]
    parts = [piece for part in parts for piece in _split_side(part)]
    sides = [_SIDES[part] for part in parts if part in _SIDES]
    rest = "_".join(part for part in parts if part not in _SIDES)
    rest = _SAME.get(rest, rest)
    return f"{sides[0]}_{rest}" if len(sides) == 1 and rest else rest


def _split_side(part: str) -> tuple[str, ...]:
    """leftknee -> left, knee."""
    for side in ("left", "right"):
        if part.startswith(side) and part != side:
            return side, part.removeprefix(side)
    return (part,)


def columns_of(names: Sequence[str], layout: str) -> dict[int, int]:
    """Column of the layout -> index in `names`, for the names that the layout has."""
    index_of: dict[str, int] = {}
    for index, name in enumerate(names):
        index_of.setdefault(plain_name(name), index)
    points = [_SAME.get(name, name) for name in layout_names(layout)]
    return {column: index_of[name] for column, name in enumerate(points) if name in index_of}


def best_layout(names: Sequence[str]) -> str | None:
    """The layout with the most matched names, the smallest of several; None if too few match."""
    fitting = {layout: len(columns_of(names, layout)) for layout in LAYOUTS}
    best = max(LAYOUTS, key=lambda layout: (fitting[layout], -len(layout_names(layout))))
    return best if fitting[best] >= MIN_MATCHED else None


NEAR = 1e-6

People = Float[np.ndarray, "_ K 3"]


def between_people(people: Mapping[int, People], number: float, nobody: People) -> People:
    """Everybody at a fractional frame number: x, y, confidence.

    Whoever is in both frames about it is between them, the others are as in the nearer frame.
    """
    before = int(np.floor(number + NEAR))
    share = number - before
    here = people.get(before, nobody)
    if share <= NEAR:
        return here
    then = people.get(before + 1, nobody)
    nearer, other = (here, then) if share <= 0.5 else (then, here)
    weight = max(share, 1 - share)
    return np.array([_mixed(p, other, weight) for p in nearer]) if len(nearer) else nearer


def _mixed(person: Float[np.ndarray, "K 3"], others: People, weight: float) -> np.ndarray:
    """A person moved towards the one of `others` who is nearest, within their own size."""
    visible = person[:, 2] > 0
    if not len(others) or not visible.any():
        return person
    away = np.linalg.norm(others[..., :2] - person[:, :2], axis=-1)
    both = visible & (others[..., 2] > 0)
    mean = np.array([a[b].mean() if b.any() else np.inf for a, b in zip(away, both, strict=True)])
    extent = np.ptp(person[visible, :2], axis=0).max()
    k = int(np.argmin(mean))
    if not mean[k] < extent:
        return person
    mixed = weight * person + (1 - weight) * others[k]
    return np.where(both[k][:, None], mixed, person)
