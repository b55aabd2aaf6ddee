"""SLEAP: the analysis .h5 of one video, as SLEAP and sleap-io export it.

``tracks`` x, y of every track, node and frame; ``point_scores`` (optional); ``node_names``. The
attribute ``dims`` of a dataset names its axes (JSON); without it they are those of SLEAP's own
export, (track, xy, node, frame). Frames count from 0. Missing points are NaN.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.part_names import matched_columns
from imocap_core.io.detectors.people import DetectedPeople, cleaned, detections
from imocap_core.io.hdf5 import members, numbers_of, open_hdf5, words_of
from imocap_core.limits import LAST_FRAME

TRACKS, SCORES, NODES = "tracks", "point_scores", "node_names"
ORDER = ("frame", "track", "node", "xy")  # of the arrays here
USUAL = ("track", "xy", "node", "frame")
_ADVICE = "export SLEAP's analysis HDF5 or CSV"


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
                f"{', '.join(parts) or 'nothing':.80}; {_ADVICE}"
            )
        names = words_of(parts[NODES])
        xy = _ordered(parts[TRACKS], ORDER, path)
        if xy.shape[2:] != (len(names), 2) or len(xy) > LAST_FRAME:
            raise ValueError(
                f"{path}: {TRACKS}: expected x, y of {len(names)} nodes, got {xy.shape[2:]} of "
                f"{len(xy)} frames; {_ADVICE}"
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
        raise ValueError(f"{path}: expected the axes {order}, got {axes} {values.shape}; {_ADVICE}")
    if values.dtype.kind not in "fiu":
        raise ValueError(f"{path}: expected numbers, got {values.dtype}; {_ADVICE}")
    return np.transpose(values, [axes.index(axis) for axis in order]).astype(np.float64)
