"""DeepLabCut and SLEAP: the CSV of one video, or its .h5.

Body parts and nodes are assigned to the points of the declared layout by name; others are ignored.

DeepLabCut's .h5 is a pandas data frame in PyTables' layout (`format="table"`). One group, of any
name, has the attribute ``pandas_type`` frame_table and the compound dataset ``table``: ``index``
(the frame) and ``values_block_0`` (C,), ... of every row. Pickled attributes name the columns:
``info`` the heading rows, ``values_block_0_kind`` the C columns of the block, tuples (scorer,
[individual,] body part, coordinate). They are read by the restricted unpickler. Its CSV has the
rows ``scorer``, (``individuals``,) ``bodyparts`` and ``coords`` (x, y, likelihood), then one row
per frame, the frame's number first, pixels.

SLEAP's analysis .h5, as SLEAP and sleap-io export it: ``tracks`` x, y of every track, node and
frame; ``point_scores`` (optional); ``node_names``. The attribute ``dims`` of a dataset names its
axes (JSON); without it they are those of SLEAP's own export, (track, xy, node, frame). Frames count
from 0. Its CSV has one row per person and frame: ``track``, ``frame_idx``, ``instance.score``, then
``NODE.x``, ``NODE.y`` (and ``NODE.score``) of every node, pixels.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from imocap_core.body.layouts import layout_names
from imocap_core.io.array_files import is_hdf5, members, numbers_of, open_hdf5, words_of
from imocap_core.io.readers.people import (
    LAYOUTS,
    DetectedPeople,
    cleaned,
    detections,
    frame_number,
    matched_columns,
    must_be_file,
    must_have_layout,
    short,
)
from imocap_core.limits import LAST_FRAME
from imocap_core.unpickle import UNREADABLE, load_pickle

HEADINGS = ("scorer", "individuals", "bodyparts", "coords")
COORDS = ("x", "y", "likelihood")


@dataclass(frozen=True)
class DeepLabCutTable:
    """headings: row's name -> its C columns. values: pixels, likelihood; NaN where missing."""

    headings: dict[str, list[str]]
    frames: Int[np.ndarray, " N"]
    values: Float[np.ndarray, "N C"]

    @property
    def body_parts(self) -> list[str]:
        """The names of the body parts, in the order of the columns."""
        return list(dict.fromkeys(self.headings["bodyparts"]))


def people_of_table(table: DeepLabCutTable, layout: str, path: Path) -> DetectedPeople:
    """All individuals of all frames; ValueError when too few body parts are the layout's."""
    parts = table.body_parts
    columns = matched_columns(parts, layout, f"{path}: bodyparts")
    individuals = table.headings.get("individuals", [""] * len(table.headings["bodyparts"]))
    heading = zip(individuals, table.headings["bodyparts"], table.headings["coords"], strict=True)
    column_of = {of_whom: n for n, of_whom in enumerate(heading)}
    frames: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for frame, values in zip(table.frames.tolist(), table.values, strict=True):
        frames[frame] = []
        for who in dict.fromkeys(individuals):
            person = np.full((len(layout_names(layout)), 3), np.nan)
            for column, part in columns.items():
                x, y, score = (column_of.get((who, parts[part], what)) for what in COORDS)
                if x is not None and y is not None:
                    likelihood = 1.0 if score is None else values[score]
                    person[column] = values[x], values[y], likelihood
            person = cleaned(person)
            if (person[:, 2] > 0).any():
                frames[frame].append(person)
    return detections(frames, layout, path)


_ADVICE = "give the .h5 that DeepLabCut wrote for a video, or its CSV (save_as_csv)"


def read_h5(path: Path) -> DeepLabCutTable:
    """The file's table. ValueError names what was expected and got."""
    with open_hdf5(path) as root:
        group = _data_frame(root, path)
        parts = members(group)
        if "table" not in parts:
            raise ValueError(f"{path}: expected a dataset table of frames, got none; {_ADVICE}")
        rows, attributes = numbers_of(parts["table"]), parts["table"].attrs
        names = rows.dtype.names or ()
        blocks = sorted(name for name in names if name.startswith("values_block_"))
        index = rows["index"] if "index" in names else np.zeros(0)
        if not blocks or index.dtype.kind not in "iu" or index.ndim != 1:
            raise ValueError(f"{path}: table: expected index and values, got {names}; {_ADVICE}")
        levels = _heading_rows(group, path)
        columns = [c for b in blocks for c in _pickled(attributes, f"{b}_kind", path)]
        of_blocks = [rows[b].reshape(len(rows), math.prod(rows.dtype[b].shape)) for b in blocks]
        values = np.concatenate(of_blocks, axis=1)
    if values.dtype.kind not in "fiu" or len(columns) != values.shape[1]:
        raise ValueError(
            f"{path}: table: expected numbers of {len(columns)} columns, got {values.dtype} "
            f"{values.shape}; {_ADVICE}"
        )
    frames = index.astype(np.int64)
    if len(frames) and not (frames.min() >= 0 and frames.max() <= LAST_FRAME):
        raise ValueError(f"{path}: table: index: expected frame numbers from 0; {_ADVICE}")
    return DeepLabCutTable(_headings(columns, levels, path), frames, values.astype(np.float64))


def _data_frame(root: Any, path: Path) -> Any:
    kinds = {name: part.attrs.get("pandas_type") for name, part in members(root).items()}
    kinds = {n: k.decode() if isinstance(k, bytes) else str(k) for n, k in kinds.items() if k}
    for name, kind in kinds.items():
        if kind == "frame_table":
            return root[name]
    got = ", ".join(kinds.values()) or ", ".join(members(root)) or "nothing"
    raise ValueError(f"{path}: expected a pandas table (frame_table), got {got:.80}; {_ADVICE}")


def _pickled(attributes: Any, name: str, path: Path) -> Any:
    content = attributes.get(name)
    try:
        return load_pickle(bytes(content))
    except UNREADABLE as error:
        reason = " ".join(str(error).split())[:120]
        raise ValueError(
            f"{path}: {name}: refused, it cannot be read safely: {reason}; {_ADVICE}"
        ) from None


def _heading_rows(group: Any, path: Path) -> list[str]:
    """The names of the heading rows, outermost first."""
    info = _pickled(group.attrs, "info", path)
    of_columns = info.get(1) if isinstance(info, dict) else None
    names = of_columns.get("names") if isinstance(of_columns, dict) else None
    expected = [name for name in HEADINGS if name != "individuals" or len(names or ()) == 4]
    if names != expected:
        raise ValueError(f"{path}: expected the headings {expected}, got {names!r:.80}; {_ADVICE}")
    return expected


def _headings(columns: Any, levels: list[str], path: Path) -> dict[str, list[str]]:
    named = [column for column in columns if isinstance(column, list)]
    if not all(len(c) == len(levels) and all(isinstance(x, str) for x in c) for c in named):
        named = []
    if len(named) != len(columns) or not any(column[-1] in COORDS for column in named):
        raise ValueError(f"{path}: expected columns of {', '.join(levels)}; {_ADVICE}")
    return {level: [column[k] for column in named] for k, level in enumerate(levels)}


UTF_16 = (b"\xff\xfe", b"\xfe\xff")
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
MISSING = ("", "none", "null", "na", "n/a")


def read_deeplabcut(path: Path, layout: str) -> DetectedPeople:
    """All individuals of all frames. ValueError names file, row, expected and got."""
    must_have_layout(LAYOUTS, layout, "a file of named body parts", path)
    return people_of_table(read_h5(path) if is_hdf5(path) else _of_csv(path), layout, path)


def body_parts(path: Path) -> list[str]:
    """The names of the body parts, in the order of the columns."""
    if is_hdf5(path):
        return read_h5(path).body_parts
    return list(dict.fromkeys(_csv_headings(read_csv(path), path)["bodyparts"]))


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


def _of_csv(path: Path) -> DeepLabCutTable:
    rows = read_csv(path)
    headings = _csv_headings(rows, path)
    count = len(headings["bodyparts"])
    frames, values = [], []
    for number, row in enumerate(rows[len(headings) :], start=len(headings) + 1):
        where = f"{path}: row {number}"
        must_be_whole(row, count + 1, where)
        values.append([cell_number(cell, where) for cell in row[1:]])
        frames.append(frame_number(int(row[0]) if row[0].strip().isdigit() else row[0], where))
    table = np.array(values, float).reshape(len(values), count)
    return DeepLabCutTable(headings, np.array(frames, dtype=np.int64), table)


def _csv_headings(rows: list[list[str]], path: Path) -> dict[str, list[str]]:
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


TRACKS, SCORES, NODES = "tracks", "point_scores", "node_names"
ORDER = ("frame", "track", "node", "xy")  # of the arrays here
USUAL = ("track", "xy", "node", "frame")
_SLEAP_ADVICE = "export SLEAP's analysis HDF5 or CSV"


def read_analysis_h5(path: Path, layout: str) -> DetectedPeople:
    """All tracks of all frames. ValueError names what was expected and got."""
    names, xy, scores = _content(path)
    columns = matched_columns(names, layout, f"{path}: nodes")
    of_layout, nodes = list(columns), list(columns.values())
    people = np.full((*xy.shape[:2], len(layout_names(layout)), 3), np.nan)
    people[:, :, of_layout, :2] = xy[:, :, nodes]
    people[:, :, of_layout, 2] = scores[:, :, nodes]
    people = cleaned(people)
    frames = {t: [p for p in here if (p[:, 2] > 0).any()] for t, here in enumerate(people)}
    return detections(frames, layout, path)


def h5_nodes(path: Path) -> list[str] | None:
    """The names of the skeleton's nodes; None when it is no analysis file."""
    with open_hdf5(path) as root:
        parts = members(root)
        return words_of(parts[NODES]) if {TRACKS, NODES} <= set(parts) else None


def _content(
    path: Path,
) -> tuple[list[str], Float[np.ndarray, "T P N 2"], Float[np.ndarray, "T P N"]]:
    with open_hdf5(path) as root:
        parts = members(root)
        missing = [name for name in (TRACKS, NODES) if name not in parts]
        if missing:
            raise ValueError(
                f"{path}: expected the datasets {TRACKS} and {NODES}, got "
                f"{', '.join(parts) or 'nothing':.80}; {_SLEAP_ADVICE}"
            )
        names = words_of(parts[NODES])
        xy = _ordered(parts[TRACKS], ORDER, path)
        if xy.shape[2:] != (len(names), 2) or len(xy) > LAST_FRAME:
            raise ValueError(
                f"{path}: {TRACKS}: expected x, y of {len(names)} nodes, got {xy.shape[2:]} of "
                f"{len(xy)} frames; {_SLEAP_ADVICE}"
            )
        scores = np.ones(xy.shape[:3])
        if SCORES in parts:
            scores = _ordered(parts[SCORES], ORDER[:3], path)
        if scores.shape != xy.shape[:3]:
            raise ValueError(f"{path}: {SCORES}: expected {xy.shape[:3]}, got {scores.shape}")
    return names, xy, np.where(np.isfinite(scores), scores, 1.0)


def _ordered(dataset: Any, order: tuple[str, ...], path: Path) -> Float[np.ndarray, "..."]:
    """A dataset with its axes in `order`."""
    given = dataset.attrs.get("dims")
    axes = tuple(json.loads(given)) if given else tuple(a for a in USUAL if a in order)
    values = numbers_of(dataset)
    if sorted(map(str, axes)) != sorted(order) or values.ndim != len(order):
        raise ValueError(
            f"{path}: expected the axes {order}, got {axes} {values.shape}; {_SLEAP_ADVICE}"
        )
    if values.dtype.kind not in "fiu":
        raise ValueError(f"{path}: expected numbers, got {values.dtype}; {_SLEAP_ADVICE}")
    return np.transpose(values, [axes.index(axis) for axis in order]).astype(np.float64)


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
        must_be_whole(row, len(heading), where)
        frame = frame_number(cell_number(row[column_of[FRAME]], where), f"{where}.{FRAME}")
        person = np.full((len(layout_names(layout)), 3), np.nan)
        for column, node in columns.items():
            x, y = (cell_number(row[column_of[f"{names[node]}.{axis}"]], where) for axis in "xy")
            score = column_of.get(f"{names[node]}.score")
            person[column] = x, y, 1.0 if score is None else cell_number(row[score], where)
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
