"""smpl_npz: SMPL parameters of one video, as `imocap export --format npz` writes them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped

from imocap_core.io.npz import load_arrays, numbers, rows_for_frames

_BODY = 66  # pelvis and the 21 joints that SMPL, SMPL-H and SMPL-X share, three numbers each


@dataclass(frozen=True)
class SmplEstimate:
    """SMPL parameters in a world, and the camera from that world.

    theta: axis-angle, radians. trans: metres, as in smplx. R, t: identity and 0 when the file has
    none; its world is then the camera's axes.
    """

    theta: Float[np.ndarray, "T 72"]
    betas: Float[np.ndarray, "10"]
    trans: Float[np.ndarray, "T 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]


def read_smpl_npz(path: Path, used_frames: Int[np.ndarray, " T"]) -> SmplEstimate:
    """The estimate at the used source frames.

    The file has ``poses`` (N, 72 or 156), ``trans`` (N, 3) and optionally ``betas`` (10,) or
    (N, 10), ``R``, ``t`` and ``frames`` (N,). The hands of 156 numbers are ignored: SMPL's hand
    joints are then at rest. Betas that change over time are averaged. ValueError names file, array,
    expected and got.
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


def _betas(arrays: dict[str, Shaped[np.ndarray, "..."]], path: Path) -> Float[np.ndarray, "10"]:
    """Ten numbers: cut or filled with zeros, averaged over time."""
    if "betas" not in arrays:
        return np.zeros(10)
    per_frame = arrays["betas"].ndim == 2
    betas = numbers(arrays, "betas", ("T", "B") if per_frame else ("B",), path)
    mean = betas.mean(axis=0) if per_frame else betas
    return np.concatenate([mean[:10], np.zeros(max(0, 10 - len(mean)))])
