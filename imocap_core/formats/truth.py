"""truth.npz: what really happened, for scoring only. Any part of it may be missing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imocap_core.formats.npz import load_arrays, names, numbers


@dataclass(frozen=True)
class VideoTruth:
    """One video: ``joints`` (T, J, 3) metres in the world, ``K`` (3, 3), ``R`` (3, 3) and ``t``
    (3,) camera from world (first frame), ``phase`` (T,), ``R_frames`` (T, 3, 3) camera from world
    in each frame of a camera that turns. None for what the file does not hold."""

    joints: NDArray[np.float64] | None
    joint_names: tuple[str, ...]
    K: NDArray[np.float64] | None
    R: NDArray[np.float64] | None
    t: NDArray[np.float64] | None
    phase: NDArray[np.float64] | None
    R_frames: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Truth:
    """``videos`` by id; frames of two videos correspond when their phases are equal, and sync
    errors are divided by ``phase_end``."""

    videos: dict[str, VideoTruth]
    phase_end: float | None


def read_truth(path: Path, ids: list[str]) -> Truth:
    """The truth of the named videos; a video the file does not speak of has None everywhere.

    ``joint_names`` may be given once, or per video as ``<id>/joint_names``.
    """
    arrays = load_arrays(path)
    end = float(numbers(arrays, "phase_end", (), path)) if "phase_end" in arrays else None
    return Truth({video: _video(arrays, video, path) for video in ids}, end)


def _video(arrays: dict[str, NDArray], video: str, path: Path) -> VideoTruth:
    def part(name: str, *shape: int | str) -> NDArray[np.float64] | None:
        key = f"{video}/{name}"
        return numbers(arrays, key, shape, path) if key in arrays else None

    joints = part("joints", "T", "J", 3)
    own = f"{video}/joint_names"
    named = own if own in arrays else "joint_names"
    joint_names = () if joints is None else names(arrays, named, joints.shape[1], path)
    return VideoTruth(
        joints,
        joint_names,
        part("K", 3, 3),
        part("R", 3, 3),
        part("t", 3),
        part("phase", "T"),
        part("R_frames", "T", 3, 3),
    )
