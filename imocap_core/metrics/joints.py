"""The joints that are compared, and their origin: the midpoint of the hips."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

HIPS = ("left_hip", "right_hip")


def missing_joints(names: Sequence[str], wanted: Sequence[str]) -> tuple[str, ...]:
    """The wanted joints that are not among ``names``, in the order wanted."""
    return tuple(name for name in wanted if name not in set(names))


def select_joints(
    joints: Float[np.ndarray, "*batch J 3"], names: Sequence[str], wanted: Sequence[str]
) -> Float[np.ndarray, "*batch W 3"]:
    """The wanted joints, in the order of ``wanted``.

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


def hip_midpoint(
    joints: Float[np.ndarray, "*batch J 3"], names: Sequence[str]
) -> Float[np.ndarray, "*batch 3"]:
    """The evaluation's pelvis: the midpoint of both hips."""
    return select_joints(joints, names, HIPS).mean(axis=-2)


def root_relative(
    joints: Float[np.ndarray, "*batch J 3"], names: Sequence[str], wanted: Sequence[str]
) -> Float[np.ndarray, "*batch W 3"]:
    """The wanted joints relative to the midpoint of the hips."""
    return select_joints(joints, names, wanted) - hip_midpoint(joints, names)[..., None, :]
