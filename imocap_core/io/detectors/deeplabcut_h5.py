"""DeepLabCut: the .h5 of one video, a pandas data frame in PyTables' layout (`format="table"`).

One group, of any name, has the attribute ``pandas_type`` frame_table and the compound dataset
``table``: ``index`` (the frame) and ``values_block_0`` (C,), ... of every row. Pickled attributes
name the columns: ``info`` the heading rows, ``values_block_0_kind`` the C columns of the block,
tuples (scorer, [individual,] body part, coordinate). They are read by the restricted unpickler.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.io.detectors.deeplabcut_table import COORDS, HEADINGS, DeepLabCutTable
from imocap_core.io.hdf5 import members, numbers_of, open_hdf5
from imocap_core.limits import LAST_FRAME
from imocap_core.unpickle import UNREADABLE, load_pickle

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
