"""MediaPipe's landmarks in a CSV, as its users save them: one row a frame, or one a landmark.

Columns of one row a frame: ``x0, y0, z0, v0, ...`` (from 0 or 1), ``landmark_0_x``, or names as
``left_knee_x``, ``LEFT_KNEE_Y``. Of one row a landmark: a frame, a landmark's number or name, x,
y, and possibly z and visibility. A column with the frame's number is used where there is one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.deeplabcut import read_csv
from imocap_core.io.detectors.part_names import plain_name
from imocap_core.io.detectors.people import frame_number

FRAME = ("frame", "frame_id", "frame_index", "frame_idx", "frame_number", "frame_num", "frame_no")
LANDMARK = ("landmark", "landmark_id", "landmark_index", "landmark_idx", "landmark_name", "id",
            "index", "idx", "point", "joint", "name", "keypoint")  # fmt: skip
AXES = {"x": 0, "y": 1, "z": 2, "v": 3, "vis": 3, "visibility": 3, "score": 3, "confidence": 3}
POINTS = 33
_AXIS = "|".join(sorted(AXES, key=len, reverse=True))
_AXIS_FIRST = re.compile(rf"({_AXIS})[_ .]?(\d+)")
_AXIS_LAST = re.compile(rf"(.*?)[_ .]({_AXIS})")


def landmark_columns(heading: Sequence[str]) -> dict[tuple[int, int], int] | None:
    """(landmark, axis) -> column, of a heading with one row a frame; None for another heading."""
    matches: list[tuple[str, int, int]] = []
    for column, cell in enumerate(heading):
        cell = cell.strip().lower()
        if match := _AXIS_FIRST.fullmatch(cell):
            matches.append((match[2], AXES[match[1]], column))
        elif match := _AXIS_LAST.fullmatch(cell):
            matches.append((match[1], AXES[match[2]], column))
    places = _landmarks([name for name, _, _ in matches])
    columns = {(places[n], axis): column for n, axis, column in matches if n in places}
    both = [k for k in range(POINTS) if (k, 0) in columns and (k, 1) in columns]
    return columns if len(both) >= POINTS // 2 else None


def is_long(heading: Sequence[str]) -> bool:
    """Whether a heading is that of one row a landmark."""
    cells = {cell.strip().lower() for cell in heading}
    return {"x", "y"} <= cells and bool(cells & set(LANDMARK)) and bool(cells & set(FRAME))


def landmarks_of_csv(path: Path) -> dict[int, Float[np.ndarray, "33 4"]]:
    """Frame -> x, y, z, visibility. ValueError names file, row, expected and got."""
    rows = read_csv(path)
    heading = [cell.strip().lower() for cell in rows[0]]
    if is_long(heading):
        return _long(rows, heading, path)
    columns = landmark_columns(heading)
    if columns is None:
        raise ValueError(
            f"{path}: expected columns x, y and visibility of MediaPipe's {POINTS} landmarks, got "
            f"{', '.join(heading):.80}"
        )
    frame = next((heading.index(name) for name in FRAME if name in heading), None)
    frames = {}
    for n, row in enumerate(rows[1:]):
        where = f"{path}: row {n + 2}"
        _must_be_whole(row, heading, where)
        number = n if frame is None else frame_number(_number(row[frame], where), where)
        frames[number] = _empty()
        for (landmark, axis), column in columns.items():
            frames[number][landmark, axis] = _number(row[column], where)
    return frames


def _long(
    rows: list[list[str]], heading: list[str], path: Path
) -> dict[int, Float[np.ndarray, "33 4"]]:
    position = {name: heading.index(name) for name in heading}
    frame, landmark = (
        next(position[n] for n in names if n in position) for names in (FRAME, LANDMARK)
    )
    places = _landmarks(
        list(dict.fromkeys(row[landmark] for row in rows[1:] if len(row) > landmark))
    )
    axes = [(axis, position[name]) for name, axis in AXES.items() if name in position]
    frames: dict[int, Float[np.ndarray, "33 4"]] = {}
    for n, row in enumerate(rows[1:], start=2):
        where = f"{path}: row {n}"
        _must_be_whole(row, heading, where)
        number = frame_number(_number(row[frame], where), where)
        table = frames.setdefault(number, _empty())
        if row[landmark] in places:
            for axis, column in axes:
                table[places[row[landmark]], axis] = _number(row[column], where)
    return frames


def _landmarks(names: Sequence[str]) -> Mapping[str, int]:
    """Landmark of each name: a number, from 0 or 1, or a part of the body."""
    digits = {n: re.findall(r"\d+", n)[-1] for n in names if re.search(r"\d+$", n.strip())}
    numbers = {name: int(d) for name, d in digits.items() if len(d) < 3}
    if len(set(numbers.values())) >= POINTS // 2:
        first = 1 if min(numbers.values()) >= 1 and POINTS in numbers.values() else 0
        return {name: n - first for name, n in numbers.items() if 0 <= n - first < POINTS}
    places = {plain_name(name): k for k, name in enumerate(layout_names("mediapipe33"))}
    return {name: places[plain_name(name)] for name in names if plain_name(name) in places}


def _empty() -> Float[np.ndarray, "33 4"]:
    table = np.full((len(layout_names("mediapipe33")), 4), np.nan)
    table[:, 2:] = 0.0, 1.0
    return table


def _must_be_whole(row: list[str], heading: list[str], where: str) -> None:
    if len(row) != len(heading):
        raise ValueError(
            f"{where}: expected {len(heading)} cells, got {len(row)}; the file is cut off?"
        )


def _number(cell: str, where: str) -> float:
    try:
        return float(cell) if cell.strip() else float("nan")
    except ValueError:
        raise ValueError(f"{where}: expected numbers only, got {cell!r:.40}") from None
