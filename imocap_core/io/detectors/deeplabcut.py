"""DeepLabCut: the CSV of one video, with three or four rows of headings.

As its documentation describes: the rows ``scorer``, (``individuals`` of projects with several,)
``bodyparts`` and ``coords`` (x, y, likelihood) name the columns; then one row a frame, the frame's
number first, pixels. Body parts have the names their project gave them: they are sorted into the
points of the declared layout by name (see `part_names`), those the layout does not have are left
out, and points without a body part are missing.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.openpose import DetectedPeople
from imocap_core.io.detectors.part_names import LAYOUTS, known_columns
from imocap_core.io.detectors.people import (
    Array,
    cleaned,
    detections,
    frame_number,
    must_be_file,
    must_be_known,
)

_H5 = (
    "is HDF5, which is not read here; export the results as CSV (DeepLabCut's save_as_csv, SLEAP's "
    "analysis CSV) and name that file"
)


def read_deeplabcut(path: Path, layout: str) -> DetectedPeople:
    """All individuals of all frames. ValueError names file, row, what is wrong."""
    must_be_known(layout, LAYOUTS, "a file of named body parts", path)
    rows = read_csv(path)
    headings = _headings(rows, path)
    parts = list(dict.fromkeys(headings["bodyparts"]))
    columns = known_columns(parts, layout, f"{path}: bodyparts")
    people = headings.get("individuals", [""] * len(headings["bodyparts"]))
    heading = list(zip(people, headings["bodyparts"], headings["coords"], strict=True))
    place = {(who, part, what): n + 1 for n, (who, part, what) in enumerate(heading)}
    found: dict[int, list[Array]] = {}
    for number, row in enumerate(rows[len(headings) :], start=len(headings) + 1):
        where = f"{path}: row {number}"
        values = _numbers(row, len(heading) + 1, where)
        frame = frame_number(_as_number(row[0]), where)
        found[frame] = []
        for who in dict.fromkeys(people):
            person = np.full((len(layout_names(layout)), 3), np.nan)
            for column, part in columns.items():
                at = [place.get((who, parts[part], what)) for what in ("x", "y", "likelihood")]
                if at[0] is not None and at[1] is not None:
                    likelihood = 1.0 if at[2] is None else values[at[2]]
                    person[column] = values[at[0]], values[at[1]], likelihood
            person = cleaned(person)
            if (person[:, 2] > 0).any():
                found[frame].append(person)
    return detections(found, layout, path)


def body_parts(path: Path) -> list[str]:
    """The names of the body parts."""
    return list(dict.fromkeys(_headings(read_csv(path), path)["bodyparts"]))


def read_csv(path: Path) -> list[list[str]]:
    """The rows of a CSV file that are not empty. ValueError says what is wrong."""
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
    known = ("scorer", "individuals", "bodyparts", "coords")
    found = {row[0].strip().lower(): row[1:] for row in rows[:4] if row[0].strip().lower() in known}
    missing = [name for name in known if name != "individuals" and name not in found]
    if missing or len({len(columns) for columns in found.values()}) > 1:
        got = ", ".join(row[0] or "(empty)" for row in rows[:4])
        raise ValueError(
            f"{path}: expected the rows scorer, bodyparts, coords of the same length first, got "
            f"{got:.80}; give DeepLabCut's CSV as it wrote it"
        )
    return {name: [cell.strip() for cell in columns] for name, columns in found.items()}


def _numbers(row: list[str], count: int, where: str) -> Array:
    """A row's cells; the empty ones are NaN, the first (the frame) too."""
    if len(row) != count:
        raise ValueError(f"{where}: expected {count} cells, got {len(row)}; the file is cut off?")
    try:
        return np.array([np.nan, *(float(cell) if cell.strip() else np.nan for cell in row[1:])])
    except ValueError as error:
        raise ValueError(f"{where}: expected numbers only: {error}") from None


def _as_number(cell: str) -> int | str:
    return int(cell) if cell.strip().isdigit() else cell
