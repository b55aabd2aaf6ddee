"""DeepLabCut: the CSV of one video, with three or four heading rows.

As its documentation describes: the rows ``scorer``, (``individuals`` in projects with several,)
``bodyparts`` and ``coords`` (x, y, likelihood) name the columns; then one row per frame, the
frame's number first, pixels. Body parts have the names that their project gave them: they are
assigned to the points of the declared layout by name (see `part_names`), those that the layout
lacks are ignored, and points without a body part are missing.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.part_names import LAYOUTS, matched_columns
from imocap_core.io.detectors.people import (
    DetectedPeople,
    cleaned,
    detections,
    frame_number,
    must_be_file,
    must_have_layout,
)

HEADINGS = ("scorer", "individuals", "bodyparts", "coords")
COORDS = ("x", "y", "likelihood")
_H5 = (
    "is HDF5, which cannot be read; export the results as CSV (DeepLabCut's save_as_csv, SLEAP's "
    "analysis CSV) and name that file"
)


def read_deeplabcut(path: Path, layout: str) -> DetectedPeople:
    """All individuals of all frames. ValueError names file, row, expected and got."""
    must_have_layout(LAYOUTS, layout, "a file of named body parts", path)
    rows = read_csv(path)
    headings = _headings(rows, path)
    parts = list(dict.fromkeys(headings["bodyparts"]))
    columns = matched_columns(parts, layout, f"{path}: bodyparts")
    people = headings.get("individuals", [""] * len(headings["bodyparts"]))
    heading = list(zip(people, headings["bodyparts"], headings["coords"], strict=True))
    column_of = {(who, part, what): n + 1 for n, (who, part, what) in enumerate(heading)}
    frames: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for number, row in enumerate(rows[len(headings) :], start=len(headings) + 1):
        where = f"{path}: row {number}"
        values = _numbers(row, len(heading) + 1, where)
        frame = frame_number(_as_number(row[0]), where)
        frames[frame] = []
        for who in dict.fromkeys(people):
            person = np.full((len(layout_names(layout)), 3), np.nan)
            for column, part in columns.items():
                x, y, score = (column_of.get((who, parts[part], w)) for w in COORDS)
                if x is not None and y is not None:
                    likelihood = 1.0 if score is None else values[score]
                    person[column] = values[x], values[y], likelihood
            person = cleaned(person)
            if (person[:, 2] > 0).any():
                frames[frame].append(person)
    return detections(frames, layout, path)


def body_parts(path: Path) -> list[str]:
    """The names of the body parts, in the order of the columns."""
    return list(dict.fromkeys(_headings(read_csv(path), path)["bodyparts"]))


def read_csv(path: Path) -> list[list[str]]:
    """The non-empty rows of a CSV file. ValueError when it cannot be read or is empty."""
    if path.suffix.lower() in (".h5", ".hdf5"):
        raise ValueError(f"{path}: {_H5}")
    must_be_file(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows = [row for row in csv.reader(stream) if any(cell.strip() for cell in row)]
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is not a CSV file ({error}); export it again") from None
    if not rows:
        raise ValueError(f"{path}: expected a CSV file with headings, got an empty file")
    return rows


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
    """A row's cells as numbers; empty ones and the first (the frame) are NaN."""
    if len(row) != count:
        raise ValueError(f"{where}: expected {count} cells, got {len(row)}; the file is cut off?")
    try:
        return np.array([np.nan, *(float(cell) if cell.strip() else np.nan for cell in row[1:])])
    except ValueError as error:
        raise ValueError(f"{where}: expected numbers only: {error}") from None


def _as_number(cell: str) -> int | str:
    return int(cell) if cell.strip().isdigit() else cell
