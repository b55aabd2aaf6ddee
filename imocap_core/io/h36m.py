"""Human3.6M as VideoPose3D's preparation scripts leave it: 3D joints, and 2D joints by CPN.

`data_3d_h36m.npz`: `positions_3d` {subject: {action: (T, 32 or 17, 3) metres, world, z up}}.
`data_2d_h36m_cpn_ft_h36m_dbb.npz`: `positions_2d` {subject: {action: [(T, 17, 2) pixels, one a
camera]}}. Videos may hold a few frames more than the motion: what only one of them has is cut.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imocap_core.io.object_npz import read_object

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
    """joints_m (T, 17, 3) in the world, z up; xy_px (4, T, 17, 2), NaN where nothing was found."""

    joints_m: NDArray[np.float64]
    xy_px: NDArray[np.float64]


def read_h36m(folder: Path) -> dict[str, dict[str, Recording]]:
    """Subject -> action -> recording, of what both files hold.

    Raises:
        ValueError: a file is missing or damaged, would run code, or holds something else; the
            sentence names file, subject and action.
    """
    joints = _tree(folder / FILE_3D, "positions_3d")
    pixels = _tree(folder / FILE_2D, "positions_2d")
    found = {
        subject: {
            action: _recording(folder, f"{subject}, {action}", joints[subject][action], seen)
            for action, seen in actions.items()
            if action in joints[subject]
        }
        for subject, actions in pixels.items()
        if subject in joints
    }
    if not any(found.values()):
        raise ValueError(f"{folder}: {FILE_3D} and {FILE_2D} share no subject and action")
    return found


def _tree(file: Path, name: str) -> Mapping[str, Mapping[str, Any]]:
    tree = read_object(file, name)
    if not isinstance(tree, dict) or not all(isinstance(value, dict) for value in tree.values()):
        raise ValueError(f"{file}: {name}: expected subject -> action -> arrays")
    return tree


def _recording(folder: Path, where: str, joints: Any, seen: Any) -> Recording:
    world = _numbers(folder / FILE_3D, where, joints, ((32, 3), (17, 3)))
    if not isinstance(seen, (list, tuple)) or len(seen) != CAMERAS:
        got = f"{len(seen)}" if isinstance(seen, (list, tuple)) else type(seen).__name__
        raise ValueError(f"{folder / FILE_2D}: {where}: expected {CAMERAS} cameras, got {got}")
    views = [_numbers(folder / FILE_2D, where, view, ((17, 2),)) for view in seen]
    length = min(len(world), *(len(view) for view in views))
    moving = world[:length, list(_OF_32)] if world.shape[1] == 32 else world[:length]
    return Recording(moving, np.stack([view[:length] for view in views]))


def _numbers(
    file: Path, where: str, value: Any, shapes: tuple[tuple[int, int], ...]
) -> NDArray[np.float64]:
    known = isinstance(value, np.ndarray) and value.dtype.kind in "fiu"
    if not known or value.shape[1:] not in shapes or not len(value):
        wanted = " or ".join(f"(T, {a}, {b})" for a, b in shapes)
        got = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value)
        raise ValueError(f"{file}: {where}: expected numbers {wanted}, got {got}")
    return np.asarray(value, dtype=np.float64)
