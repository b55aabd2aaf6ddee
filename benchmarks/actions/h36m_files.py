"""Human3.6M as VideoPose3D's preparation scripts write it: 3D joints, and 2D joints by CPN.

`data_3d_h36m.npz`: `positions_3d` {subject: {action: (T, 32 or 17, 3) metres, world, z up}}.
`data_2d_h36m_cpn_ft_h36m_dbb.npz`: `positions_2d` {subject: {action: [(T, 17, 2) pixels, one a
camera]}}. Videos may have a few more frames than the motion; both are cut to the shorter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.array_files import read_object

FILE_3D, FILE_2D = "data_3d_h36m.npz", "data_2d_h36m_cpn_ft_h36m_dbb.npz"
FPS = 50.0
SIZE = (1000, 1002)  # pixels; the cameras' pictures are 1000 x 1000 or 1000 x 1002
CAMERAS = 4
# The 17 of the 32 joints that move, by the project's names; `head` is the top of the head there.
H36M_17: tuple[str, ...] = (
    *("pelvis", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle"),
    *("spine2", "neck", "nose", "head", "left_shoulder", "left_elbow", "left_wrist"),
    *("right_shoulder", "right_elbow", "right_wrist"),
)
_OF_32 = (0, 1, 2, 3, 6, 7, 8, 12, 13, 14, 15, 17, 18, 19, 25, 26, 27)


@dataclass(frozen=True)
class Recording:
    """One subject's action: world joints (z up) and detections of the four cameras, NaN where
    missing."""

    joints_m: Float[np.ndarray, "T 17 3"]
    xy_px: Float[np.ndarray, "4 T 17 2"]


def read_h36m(folder: Path) -> dict[str, dict[str, Recording]]:
    """Subject -> action -> recording, of the actions that are in both files.

    Raises:
        ValueError: a file is missing, damaged, would run code, or has other content; the message
            names file, subject and action.
    """
    joints = _tree(folder / FILE_3D, "positions_3d")
    pixels = _tree(folder / FILE_2D, "positions_2d")
    recordings = {
        subject: {
            action: _recording(folder, f"{subject}, {action}", joints[subject][action], cameras)
            for action, cameras in actions.items()
            if action in joints[subject]
        }
        for subject, actions in pixels.items()
        if subject in joints
    }
    if not any(recordings.values()):
        raise ValueError(f"{folder}: {FILE_3D} and {FILE_2D} share no subject and action")
    return recordings


def _tree(file: Path, name: str) -> Mapping[str, Mapping[str, Any]]:
    tree = read_object(file, name)
    if not isinstance(tree, dict) or not all(isinstance(value, dict) for value in tree.values()):
        raise ValueError(f"{file}: {name}: expected subject -> action -> arrays")
    return tree


def _recording(folder: Path, where: str, joints: Any, cameras: Any) -> Recording:
    world = _numbers(folder / FILE_3D, where, joints, ((32, 3), (17, 3)))
    if not isinstance(cameras, (list, tuple)) or len(cameras) != CAMERAS:
        got = f"{len(cameras)}" if isinstance(cameras, (list, tuple)) else type(cameras).__name__
        raise ValueError(f"{folder / FILE_2D}: {where}: expected {CAMERAS} cameras, got {got}")
    views = [_numbers(folder / FILE_2D, where, view, ((17, 2),)) for view in cameras]
    length = min(len(world), *(len(view) for view in views))
    moving = world[:length, list(_OF_32)] if world.shape[1] == 32 else world[:length]
    return Recording(moving, np.stack([view[:length] for view in views]))


def _numbers(
    file: Path, where: str, value: Any, shapes: tuple[tuple[int, int], ...]
) -> Float[np.ndarray, "T J d"]:
    numeric = isinstance(value, np.ndarray) and value.dtype.kind in "fiu"
    if not numeric or value.shape[1:] not in shapes or not len(value):
        expected = " or ".join(f"(T, {a}, {b})" for a, b in shapes)
        got = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value)
        raise ValueError(f"{file}: {where}: expected numbers {expected}, got {got}")
    return np.asarray(value, dtype=np.float64)
