"""joints_npz: any monocular estimator's 3D joints of one video."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imocap_core.io.npz import load_arrays, names, numbers, rows_for_frames


@dataclass(frozen=True)
class JointsEstimate:
    """``joints`` (T, J, 3) metres in camera axes, root-relative or not; NaN where missing."""

    joints: NDArray[np.float64]
    joint_names: tuple[str, ...]


def read_joints_npz(path: Path, used_frames: NDArray[np.int64]) -> JointsEstimate:
    """The estimate at the used source frames (T,).

    The file holds ``joints`` (N, J, 3), ``joint_names`` (J,) and, optionally, ``frames`` (N,);
    see `rows_for_frames` for files without.
    """
    arrays = load_arrays(path)
    joints = numbers(arrays, "joints", ("T", "J", 3), path)
    joint_names = names(arrays, "joint_names", joints.shape[1], path)
    rows = rows_for_frames(arrays, len(joints), used_frames, path)
    return JointsEstimate(joints[rows], joint_names)
