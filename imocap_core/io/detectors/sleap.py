"""SLEAP: the analysis CSV of one video, one row per person and frame, or its analysis .h5.

As SLEAP exports it: ``track``, ``frame_idx``, ``instance.score``, then ``NODE.x``, ``NODE.y`` (and
``NODE.score``) of every node of the skeleton, pixels. Nodes are assigned to the points of
the declared layout by name (see `part_names`). Tracks and scores of instances are not used: people
are tracked by their joints.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.deeplabcut import read_csv
from imocap_core.io.detectors.part_names import LAYOUTS, matched_columns
from imocap_core.io.detectors.people import (
    DetectedPeople,
    cleaned,
    detections,
    frame_number,
    must_have_layout,
    short,
)
from imocap_core.io.detectors.sleap_h5 import read_analysis_h5
from imocap_core.io.hdf5 import is_hdf5

FRAME = "frame_idx"


def read_sleap(path: Path, layout: str) -> DetectedPeople:
    """All instances of all frames. ValueError names file, row, expected and got."""
    must_have_layout(LAYOUTS, layout, "a file of named body parts", path)
    if is_hdf5(path):
        return read_analysis_h5(path, layout)
    rows = read_csv(path)
    heading, names = rows[0], _nodes(rows[0], path)
    columns = matched_columns(names, layout, f"{path}: nodes")
    column_of = {name: n for n, name in enumerate(heading)}
    people: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for number, row in enumerate(rows[1:], start=2):
        where = f"{path}: row {number}"
        if len(row) != len(heading):
            raise ValueError(
                f"{where}: expected {len(heading)} cells, got {len(row)}; the file is cut off?"
            )
        frame = frame_number(_number(row[column_of[FRAME]], where), f"{where}.{FRAME}")
        person = np.full((len(layout_names(layout)), 3), np.nan)
        for column, node in columns.items():
            x, y = (_number(row[column_of[f"{names[node]}.{axis}"]], where) for axis in "xy")
            score = column_of.get(f"{names[node]}.score")
            person[column] = x, y, 1.0 if score is None else _number(row[score], where)
        people.setdefault(frame, []).append(cleaned(person))
    return detections(people, layout, path)


def nodes(path: Path) -> list[str]:
    """The names of the skeleton's nodes, in the order of the columns."""
    return _nodes(read_csv(path)[0], path)


def _nodes(heading: list[str], path: Path) -> list[str]:
    names = [name.removesuffix(".x") for name in heading if name.endswith(".x")]
    if FRAME not in heading or not names or any(f"{name}.y" not in heading for name in names):
        raise ValueError(
            f"{path}: expected a heading with {FRAME} and NODE.x, NODE.y of every node, got "
            f"{', '.join(heading):.80}; export SLEAP's analysis CSV"
        )
    return names


def _number(cell: str, where: str) -> float:
    """A cell as a number, NaN when it is empty."""
    try:
        return float(cell) if cell.strip() else float("nan")
    except ValueError:
        raise ValueError(f"{where}: expected numbers only, got {short(cell)}") from None
