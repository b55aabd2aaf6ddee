"""What the readers of monocular 3D estimates share: fields checked, the performer's rows found.

Of a monocular estimator's result the joint rotations (or the joints) are used, in camera axes
(x right, y down, z forward). Its translation is not: how far away it puts the body depends on the
focal length each tool assumes, so the body is placed where the keypoints are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.io.detectors.people import LARGEST, short, type_name
from imocap_core.rotations import exp

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
JOINTS = 24  # SMPL's
REACH = 0.75  # of the performer's larger side: further away it is somebody else
_LOOSE = 0.05  # how far R Rᵀ of a rotation matrix may be from 1


@dataclass(frozen=True)
class PerformerBoxes:
    """The used source frames (T,), the performer's box (T, 4) x0 y0 x1 y1 in each (pixels, NaN
    where unseen) and the picture's size (width, height)."""

    frames: Rows
    box_px: Array
    size: tuple[int, int]


@dataclass(frozen=True)
class Entries:
    """Everything a file holds: the frame of each estimate (N,), whose it is (N,), where in the
    picture that person is (N, 2) pixels, or None when the file does not say."""

    frames: Rows
    track: Rows
    middle_px: Array | None


def performer_rows(entries: Entries, performer: PerformerBoxes, path: Path) -> Rows:
    """For each used frame (T,) the performer's estimate, -1 where there is none.

    The performer is who the keypoints say: of several people in a frame the one nearest to the
    performer's box. Where a file tells no places, the track that is in most of the used frames.

    ValueError when no used frame has any.
    """
    used = {int(frame): row for row, frame in enumerate(performer.frames)}
    rows = np.full(len(performer.frames), -1, dtype=np.int64)
    here = np.array([int(frame) in used for frame in entries.frames], dtype=bool)
    alone = len(set(entries.frames[here].tolist())) == int(here.sum())
    keep = here
    if not alone and entries.middle_px is None:
        tracks, counts = np.unique(entries.track[here], return_counts=True)
        keep = here & (entries.track == tracks[counts.argmax()])
    if not alone and entries.middle_px is not None:
        keep = here & _nearest(entries, performer, used)
    for n in np.flatnonzero(keep):
        rows[used[int(entries.frames[n])]] = n
    if (rows < 0).all():
        have = (
            f"{entries.frames.min()} to {entries.frames.max()}" if len(entries.frames) else "none"
        )
        where = " where the keypoints have the performer" if here.any() else ""
        first, last = performer.frames[0], performer.frames[-1]
        raise ValueError(
            f"{path}: expected an estimate in frames {first} to {last}{where}, got frames {have}; "
            "give the estimate of this very video"
        )
    return rows


def _nearest(
    entries: Entries, performer: PerformerBoxes, used: dict[int, int]
) -> NDArray[np.bool_]:
    """Which entries (N,) are the nearest to the performer's box in their frames."""
    assert entries.middle_px is not None
    places = np.where(np.abs(entries.middle_px) < LARGEST, entries.middle_px, np.nan)
    best: dict[int, tuple[float, int]] = {}
    for n, frame in enumerate(entries.frames):
        if int(frame) not in used:
            continue
        box = performer.box_px[used[int(frame)]]
        away = float(np.linalg.norm(places[n] - 0.5 * (box[:2] + box[2:])))
        reach = REACH * float(np.max(box[2:] - box[:2]))
        if away <= min(reach, best.get(int(frame), (np.inf, -1))[0]):  # NaN is never
            best[int(frame)] = (away, n)
    keep = np.zeros(len(entries.frames), dtype=bool)
    keep[[n for _, n in best.values()]] = True
    return keep


def picked(values: Array, rows: Rows) -> Array:
    """values (N, ...) at rows (T,), NaN where the row is -1."""
    found = values[np.maximum(rows, 0)].astype(np.float64)
    found[rows < 0] = np.nan
    return found


def field(record: Any, name: str, shape: Sequence[int | str], where: str) -> Array:
    """Numbers ``name`` of a dictionary, float64; ValueError unless their shape matches.

    Text in `shape` matches any length.
    """
    wanted = "(" + ", ".join(map(str, shape)) + ")"
    if not isinstance(record, dict):
        raise ValueError(f"{where}: expected a dictionary with {name}, got {type_name(record)}")
    value = record.get(name)
    if isinstance(value, list):
        try:
            value = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise ValueError(f"{where}: {name}: expected numbers {wanted}, got a list") from None
    if not isinstance(value, np.ndarray):
        have = ", ".join(map(str, record)) or "nothing"
        raise ValueError(
            f"{where}: {name}: expected numbers {wanted}, got {type_name(value)}; has: {have:.80}"
        )
    fits = value.ndim == len(shape) and all(
        isinstance(want, str) or got == want for got, want in zip(value.shape, shape, strict=True)
    )
    if not fits or value.dtype.kind not in "fiu":
        raise ValueError(
            f"{where}: {name}: expected numbers {wanted}, got {value.dtype} {value.shape}"
        )
    return value.astype(np.float64)


def from_vectors(vectors: Array) -> Array:
    """Rotations (N, 24, 3, 3) of axis-angle vectors (N, 72 or fewer); the rest is at rest."""
    full = np.zeros((len(vectors), 3 * JOINTS))
    full[:, : vectors.shape[1]] = vectors
    return exp(torch.as_tensor(full.reshape(-1, JOINTS, 3))).numpy()


def checked_rotations(matrices: Array, where: str) -> Array:
    """The matrices (N, 24, 3, 3); ValueError unless they are rotations (or NaN)."""
    known = np.where(np.abs(matrices) < 2, matrices, 2.0)  # no rotation, but finite
    known[np.isnan(matrices).any(axis=(-1, -2))] = np.eye(3)
    off = np.abs(known @ np.swapaxes(known, -1, -2) - np.eye(3)).max(axis=(-1, -2))
    wrong = (off > _LOOSE) | (np.linalg.det(known) < 0)
    if wrong.any():
        n, joint = np.argwhere(wrong)[0]
        raise ValueError(
            f"{where}: expected rotation matrices, got something else in row {n}, joint {joint}"
        )
    return matrices


def frame_ids(values: Array, where: str) -> Rows:
    """Frame numbers (N,); ValueError unless they are some."""
    if not (np.isfinite(values).all() and (values >= 0).all() and (values % 1 == 0).all()):
        raise ValueError(f"{where}: expected frame numbers from 0, got {short(values)}")
    return values.astype(np.int64)


def people_of(content: Any, path: Path) -> dict[str, Any]:
    """Person -> fields, as VIBE and WHAM have them; ValueError when it is something else."""
    if not isinstance(content, dict) or not content:
        got = "an empty one" if content == {} else type_name(content)
        raise ValueError(f"{path}: expected a dictionary of people, got {got}")
    return {str(name): fields for name, fields in content.items()}
