"""A limb and the trunk in the picture, independent of their place and size: a network's input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import SIDES

LIMBS = {"shoulder": ("elbow", "wrist"), "hip": ("knee", "ankle")}  # trunk's ends: what they carry
TRUNK = tuple(LIMBS)  # whose marks are corrected
POINTS = (*(f"{side}_{p}" for side in SIDES for end in TRUNK for p in (end, *LIMBS[end])), "nose")
FEATURES = 12


@dataclass(frozen=True)
class LeftLimb:
    """The left limb of an end of the trunk, and the trunk, in units of the body's spread.

    Attributes:
        features: (T, 12) x and y of six vectors: from the end to the limb's joints, between the
            shoulders, between the hips, along the trunk, from it to the nose.
        spread_px: (T,) root mean square distance of `POINTS` from their mean.
    """

    features: Float[np.ndarray, "T 12"]
    spread_px: Float[np.ndarray, " T"]


def left_limb(xy_px: Float[np.ndarray, "T K 2"], names: Sequence[str], end: str) -> LeftLimb:
    """The input for the left side of an end of the trunk, of finite keypoints of some names."""
    point = {name: xy_px[:, list(names).index(name)] for name in POINTS}
    left, right = (
        {name: point[f"{side}_{name}"] for part in TRUNK for name in (part, *LIMBS[part])}
        for side in SIDES
    )
    shoulders, hips = ((left[part] + right[part]) / 2 for part in TRUNK)
    vectors = [left[name] - left[end] for name in LIMBS[end]]
    vectors += [left[part] - right[part] for part in TRUNK]
    vectors += [shoulders - hips, point["nose"] - shoulders]
    every = np.stack(list(point.values()), axis=1)
    away = every - every.mean(axis=1, keepdims=True)
    spread = np.maximum(np.sqrt((away**2).sum(axis=-1).mean(axis=1)), 1e-6)
    return LeftLimb(np.concatenate(vectors, axis=1) / spread[:, None], spread)


def filled_in_time(xy_px: Float[np.ndarray, "T K 2"]) -> Float[np.ndarray, "T K 2"]:
    """Linear interpolation over time of missing points, constant beyond the ends; a point that is
    in no frame stays NaN."""
    filled = xy_px.copy()
    every = np.arange(len(xy_px))
    for k, axis in np.ndindex(*xy_px.shape[1:]):
        column = xy_px[:, k, axis]
        rows = np.flatnonzero(np.isfinite(column))
        if len(rows):
            filled[:, k, axis] = np.interp(every, rows, column[rows])
    return filled
