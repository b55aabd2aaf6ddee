"""smpl_npz: SMPL parameters of one video, as `imocap export --format npz` writes them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imocap_core.io.npz import load_arrays, numbers, rows_for_frames

_BODY = 66  # pelvis and the 21 joints that SMPL, SMPL-H and SMPL-X share, three numbers each


@dataclass(frozen=True)
class SmplEstimate:
    """``theta`` (T, 72) radians, ``betas`` (10,), ``trans`` (T, 3) metres (as in smplx), in the
    axes of a world that ``R`` (3, 3) and ``t`` (3,) take to the camera (identity and 0 when the
    file has none: it then already speaks in camera axes)."""

    theta: NDArray[np.float64]
    betas: NDArray[np.float64]
    trans: NDArray[np.float64]
    R: NDArray[np.float64]
    t: NDArray[np.float64]


def read_smpl_npz(path: Path, used_frames: NDArray[np.int64]) -> SmplEstimate:
    """The estimate at the used source frames (T,).

    The file holds ``poses`` (N, 72 or 156), ``trans`` (N, 3) and optionally ``betas`` (10,) or
    (N, 10), ``R``, ``t`` and ``frames`` (N,). The hands of 156 numbers are left out: SMPL's hand
    joints are then at rest. Betas that change over time are averaged.
    """
    arrays = load_arrays(path)
    poses = numbers(arrays, "poses", ("T", "72 or 156"), path)
    if poses.shape[1] not in (72, 156):
        raise ValueError(f"{path}: poses: expected 72 or 156 columns, got {poses.shape[1]}")
    rows = rows_for_frames(arrays, len(poses), used_frames, path)
    trans = numbers(arrays, "trans", (len(poses), 3), path)
    theta = poses[rows, :72]
    if poses.shape[1] == 156:
        theta = theta.copy()
        theta[:, _BODY:] = 0.0
    return SmplEstimate(
        theta,
        _betas(arrays, path),
        trans[rows],
        numbers(arrays, "R", (3, 3), path) if "R" in arrays else np.eye(3),
        numbers(arrays, "t", (3,), path) if "t" in arrays else np.zeros(3),
    )


def _betas(arrays: dict[str, NDArray], path: Path) -> NDArray[np.float64]:
    """Ten numbers: cut or filled with zeros, averaged over time."""
    if "betas" not in arrays:
        return np.zeros(10)
    per_frame = arrays["betas"].ndim == 2
    betas = numbers(arrays, "betas", ("T", "B") if per_frame else ("B",), path)
    mean = betas.mean(axis=0) if per_frame else betas
    return np.concatenate([mean[:10], np.zeros(max(0, 10 - len(mean)))])
