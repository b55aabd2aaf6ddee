"""TRAM: `hps/hps_track_0.npy` (and further tracks), one person each, saved by its script.

``pred_rotmat`` (N, 24, 3, 3) are rotation matrices in camera axes and ``frame`` (N,) the frame
numbers, torch tensors in a pickled dictionary; ``pred_trans`` (N, 1, 3) with ``img_focal`` and
``img_center``, which are optional, give the person's position. A folder stands for all its tracks,
a file for that person alone. Shape and weak-perspective camera are not used.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.estimators.estimates import (
    JOINTS,
    Entries,
    PerformerBoxes,
    checked_rotations,
    field,
    frame_ids,
    performer_rows,
    select_rows,
)
from imocap_core.io.pickles import read_results


def read_tram(path: Path, performer: PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes, NaN where missing.

    ValueError names file, field, expected and got.
    """
    files = sorted(path.glob("hps_track_*.npy")) if path.is_dir() else [path]
    if not files:
        raise ValueError(f"{path}: expected hps_track_0.npy and so on in the folder, found none")
    frames, track, middle, poses = [], [], [], []
    for number, file in enumerate(files):
        content = read_results(file)
        rotations = field(content, "pred_rotmat", ("N", JOINTS, 3, 3), str(file))
        given = field(content, "frame", (len(rotations),), str(file))
        frames.append(frame_ids(given, f"{file}: frame"))
        track.append(np.full(len(rotations), number))
        middle.append(_middle(content, len(rotations)))
        poses.append(checked_rotations(rotations, f"{file}: pred_rotmat"))
    places = (
        None
        if any(m is None for m in middle)
        else np.concatenate([m for m in middle if m is not None])
    )
    entries = Entries(np.concatenate(frames), np.concatenate(track), places)
    return select_rows(np.concatenate(poses), performer_rows(entries, performer, path))


def _middle(content: Any, count: int) -> Float[np.ndarray, "N 2"] | None:
    """The person's position in pixels, or None when the file has none."""
    given = [content.get(name) for name in ("pred_trans", "img_focal", "img_center")]
    if any(value is None for value in given):
        return None
    trans, focal, center = (np.asarray(value) for value in given)
    if any(values.dtype.kind not in "fiu" for values in (trans, focal, center)):
        return None
    if trans.size != 3 * count or center.size < 2 or focal.size < 1:
        return None
    xyz = trans.astype(np.float64).reshape(count, 3)
    depth = np.where(xyz[:, 2:] > 0, xyz[:, 2:], np.nan)
    return float(focal.ravel()[0]) * xyz[:, :2] / depth + center.ravel()[:2]
