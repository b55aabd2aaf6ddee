"""joints_npz: any monocular estimator's 3D joints of one video."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from imocap_core.io.npz import load_arrays, names, numbers, rows_for_frames


@dataclass(frozen=True)
class JointsEstimate:
    """Joints in metres, camera axes, root-relative or not; NaN where missing."""

    joints: Float[np.ndarray, "T J 3"]
    joint_names: tuple[str, ...]


def read_joints_npz(path: Path, used_frames: Int[np.ndarray, " T"]) -> JointsEstimate:
    """The estimate at the used source frames.

    The file has ``joints`` (N, J, 3), ``joint_names`` (J,) and, optionally, ``frames`` (N,);
    see `rows_for_frames` for files without. ValueError names file, array, expected and got.
    """
    arrays = load_arrays(path)
    joints = numbers(arrays, "joints", ("T", "J", 3), path)
    joint_names = names(arrays, "joint_names", joints.shape[1], path)
    rows = rows_for_frames(arrays, len(joints), used_frames, path)
    return JointsEstimate(joints[rows], joint_names)
