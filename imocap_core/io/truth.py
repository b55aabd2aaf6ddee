"""truth.npz: what really happened, for scoring only. Any part of it may be missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imocap_core.io.npz import load_arrays, names, numbers, rows_for_frames


@dataclass(frozen=True)
class VideoTruth:
    """One video at its T used frames: ``joints`` (T, J, 3) metres in the world, ``K`` (3, 3), ``R``
    (3, 3) and ``t`` (3,) camera from world (first used frame), ``phase`` (T,), ``R_frames``
    (T, 3, 3) camera from world in each frame of a camera that turns about its centre, ``hands``
    (T, 2, 21, 3) OpenPose's points of the left and the right hand in the world. None for what the
    file does not hold."""

    joints: NDArray[np.float64] | None
    joint_names: tuple[str, ...]
    K: NDArray[np.float64] | None
    R: NDArray[np.float64] | None
    t: NDArray[np.float64] | None
    phase: NDArray[np.float64] | None
    R_frames: NDArray[np.float64] | None = None
    hands: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Truth:
    """``videos`` by id; frames of two videos correspond when their phases are equal, and sync
    errors are divided by ``phase_end``."""

    videos: dict[str, VideoTruth]
    phase_end: float | None


def read_truth(path: Path, used_frames: Mapping[str, NDArray[np.int64]]) -> Truth:
    """The truth of some videos (id -> (T,) used source frames); None where the file says nothing.

    ``joint_names`` may be given once, or per video as ``<id>/joint_names``. Which source frame a
    row is, ``<id>/frames`` says; see `rows_for_frames` for files without. ``R`` and ``t`` are those
    of the first used frame, or of the first row when the file holds ``R_frames``.
    """
    arrays = load_arrays(path)
    end = float(numbers(arrays, "phase_end", (), path)) if "phase_end" in arrays else None
    return Truth({v: _video(arrays, v, used, path) for v, used in used_frames.items()}, end)


def _video(
    arrays: dict[str, NDArray], video: str, used: NDArray[np.int64], path: Path
) -> VideoTruth:
    def part(name: str, *shape: int | str) -> NDArray[np.float64] | None:
        key = f"{video}/{name}"
        return numbers(arrays, key, shape, path) if key in arrays else None

    def at_used(name: str, *shape: int | str) -> NDArray[np.float64] | None:
        array = part(name, "T", *shape)
        if array is None:
            return None
        return array[rows_for_frames(arrays, len(array), used, path, f"{video}/frames")]

    joints = at_used("joints", "J", 3)
    own = f"{video}/joint_names"
    named = own if own in arrays else "joint_names"
    joint_names = () if joints is None else names(arrays, named, joints.shape[1], path)
    R, t, R_frames = part("R", 3, 3), part("t", 3), at_used("R_frames", 3, 3)
    if R_frames is not None and R is not None:
        t = None if t is None else R_frames[0] @ R.T @ t  # the centre -R^T t stays
        R = R_frames[0]
    return VideoTruth(
        joints,
        joint_names,
        part("K", 3, 3),
        R,
        t,
        at_used("phase"),
        R_frames,
        at_used("hands", 2, 21, 3),
    )
