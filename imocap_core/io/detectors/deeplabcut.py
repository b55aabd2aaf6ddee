"""DeepLabCut: the CSV of one video, with three or four heading rows, or its .h5.

As its documentation describes: the rows ``scorer``, (``individuals`` in projects with several,)
``bodyparts`` and ``coords`` (x, y, likelihood) name the columns; then one row per frame, the
frame's number first, pixels. Body parts have the names that their project gave them: they are
assigned to the points of the declared layout by name (see `part_names`), those that the layout
lacks are ignored, and points without a body part are missing.
"""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.deeplabcut_h5 import read_h5
from imocap_core.io.detectors.deeplabcut_table import HEADINGS, DeepLabCutTable, people_of_table
from imocap_core.io.detectors.part_names import LAYOUTS
from imocap_core.io.detectors.people import (
    DetectedPeople,
    frame_number,
    must_be_file,
    must_have_layout,
)
from imocap_core.io.hdf5 import is_hdf5

UTF_16 = (b"\xff\xfe", b"\xfe\xff")
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")


def read_deeplabcut(path: Path, layout: str) -> DetectedPeople:
    """All individuals of all frames. ValueError names file, row, expected and got."""
    must_have_layout(LAYOUTS, layout, "a file of named body parts", path)
    return people_of_table(read_h5(path) if is_hdf5(path) else _of_csv(path), layout, path)


def body_parts(path: Path) -> list[str]:
    """The names of the body parts, in the order of the columns."""
    if is_hdf5(path):
        return read_h5(path).body_parts
    return list(dict.fromkeys(_headings(read_csv(path), path)["bodyparts"]))


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
            rows = [[_with_point(cell) for cell in row] for row in rows]
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is not a CSV file ({error}); export it again") from None
    if not rows:
        raise ValueError(f"{path}: expected a CSV file with headings, got an empty file")
    return rows


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell.strip()) else cell


def _of_csv(path: Path) -> DeepLabCutTable:
    rows = read_csv(path)
    headings = _headings(rows, path)
    count = len(headings["bodyparts"])
    frames, values = [], []
    for number, row in enumerate(rows[len(headings) :], start=len(headings) + 1):
        where = f"{path}: row {number}"
        values.append(_numbers(row, count, where))
        frames.append(frame_number(_as_number(row[0]), where))
    table = np.array(values).reshape(len(values), count)
    return DeepLabCutTable(headings, np.array(frames, dtype=np.int64), table)


def _headings(rows: list[list[str]], path: Path) -> dict[str, list[str]]:
    """Row name -> its columns, of the rows before the frames."""
    named = {row[0].strip().lower(): row[1:] for row in rows[:4]}
    headings = {name: named[name] for name in HEADINGS if name in named}
    missing = [name for name in HEADINGS if name != "individuals" and name not in headings]
    if missing or len({len(columns) for columns in headings.values()}) > 1:
        got = ", ".join(row[0] or "(empty)" for row in rows[:4])
        raise ValueError(
            f"{path}: expected the rows scorer, bodyparts, coords of the same length first, got "
            f"{got:.80}; give DeepLabCut's CSV as it wrote it"
        )
    return {name: [cell.strip() for cell in columns] for name, columns in headings.items()}


def _numbers(row: list[str], count: int, where: str) -> Float[np.ndarray, " _"]:
    """The `count` numbers after a row's first cell, the frame; empty ones are NaN."""
    if len(row) != count + 1:
        raise ValueError(
            f"{where}: expected {count + 1} cells, got {len(row)}; the file is cut off?"
        )
    try:
        return np.array([float(cell) if cell.strip() else np.nan for cell in row[1:]])
    except ValueError as error:
        raise ValueError(f"{where}: expected numbers only: {error}") from None


def _as_number(cell: str) -> int | str:
    return int(cell) if cell.strip().isdigit() else cell
