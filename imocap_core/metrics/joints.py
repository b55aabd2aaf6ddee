"""Which joints are compared, and from which origin (method: pelvis = midpoint of the hips)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

HIPS = ("left_hip", "right_hip")


def missing_joints(names: Sequence[str], wanted: Sequence[str]) -> tuple[str, ...]:
    """The wanted joints that ``names`` has not, in the order wanted."""
    return tuple(name for name in wanted if name not in set(names))


def select_joints(joints: ArrayLike, names: Sequence[str], wanted: Sequence[str]) -> Array:
    """Columns of joints (..., J, 3), reordered as ``wanted``.

    Raises:
        ValueError: ``names`` does not name every joint, or lacks one that is wanted.
    """
    x = np.asarray(joints, dtype=np.float64)
    if x.ndim < 2 or x.shape[-2:] != (len(names), 3):
        raise ValueError(f"joints must be (..., {len(names)}, 3) to match its names, got {x.shape}")
    absent = missing_joints(names, wanted)
    if absent:
        raise ValueError(f"joints lack {', '.join(absent)}; they have {', '.join(names)}")
    index = {name: i for i, name in enumerate(names)}
    return x[..., [index[name] for name in wanted], :]


def hip_midpoint(joints: ArrayLike, names: Sequence[str]) -> Array:
    """The evaluation's pelvis (..., 3): midpoint of the hips of joints (..., J, 3)."""
    return select_joints(joints, names, HIPS).mean(axis=-2)


def root_relative(joints: ArrayLike, names: Sequence[str], wanted: Sequence[str]) -> Array:
    """The wanted joints (..., W, 3) as seen from the midpoint of the hips."""
    return select_joints(joints, names, wanted) - hip_midpoint(joints, names)[..., None, :]
