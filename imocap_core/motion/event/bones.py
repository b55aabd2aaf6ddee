"""Bones keep their length: a soft term that ties the points of one moment to those of others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

LIMBS = (
    ("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"),
    ("ankle", "big_toe"), ("ankle", "heel"), ("shoulder", "hip"),
)  # fmt: skip
ACROSS = (("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"))
MIDDLE = (("upper_neck", "head_top"),)


@dataclass(frozen=True)
class BoneLengths:
    """Lengths of B bones at N moments.

    Attributes:
        direction: (N, B, 3) unit vector from a bone's second point to its first.
        length_m: (N, B); present: (N, B) both points are placed.
    """

    direction: Float[np.ndarray, "N B 3"]
    length_m: Float[np.ndarray, "N B"]
    present: Bool[np.ndarray, "N B"]


def bones_of(names: Sequence[str]) -> Int[np.ndarray, "B 2"]:
    """The bones between keypoints of these names, as pairs of columns."""
    column = {name: k for k, name in enumerate(names)}
    limbs = [(f"{s}_{a}", f"{s}_{b}") for s in ("left", "right") for a, b in LIMBS]
    pairs = [(column[a], column[b]) for a, b in (*limbs, *ACROSS, *MIDDLE) if {a, b} <= {*column}]
    return np.array(pairs, dtype=int).reshape(-1, 2)


def bone_lengths(
    points: Float[np.ndarray, "N J 3"],
    placed: Bool[np.ndarray, "N J"],
    bones: Int[np.ndarray, "B 2"],
) -> BoneLengths:
    """Lengths and directions of the bones; ``placed``: points that enough cameras see."""
    a, b = bones.T
    along = points[:, a] - points[:, b]
    length = np.linalg.norm(along, axis=-1)
    direction = along / np.maximum(length, 1e-6)[..., None]
    return BoneLengths(direction, length, placed[:, a] & placed[:, b])


def typical_lengths(bones: BoneLengths) -> Float[np.ndarray, " B"]:
    """Median length of each bone over the moments that show it; 0 where none does."""
    lengths = np.where(bones.present, bones.length_m, np.nan)
    ever = np.any(bones.present, axis=0)
    out = np.zeros(lengths.shape[1])
    out[ever] = np.nanmedian(lengths[:, ever], axis=0)
    return out
