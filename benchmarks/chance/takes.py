"""Captured takes of one action: joints about the hips, facing one way, and angles of the limbs."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float

BENDS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False)
class CapturedTake:
    """One take at 30 frames a second; joints: (T, J, 3) metres, z up; names: of the joints."""

    fps: ClassVar[float] = 30.0
    joints: Float[np.ndarray, "T J 3"]
    names: tuple[str, ...]

    def angles_deg(self, joints: Float[np.ndarray, "N J 3"]) -> dict[str, Float[np.ndarray, " N"]]:
        """Bend of elbows and knees, and how far upper arms and thighs are raised from the
        vertical; joints: of any take with these names."""
        angles = {}
        for side in "lr":
            for bend in BENDS:
                upper, middle, end = (
                    joints[:, self.names.index(f"{side}_{name}")] for name in bend
                )
                angles[f"{side}_{bend[1]}"] = between_deg(middle - upper, end - middle)
                angles[f"{side}_{bend[0]}"] = between_deg(middle - upper, DOWN)
        return angles


def takes_of(file: Path) -> list[CapturedTake]:
    """All takes of a file of captured motion, about the hips, the hips of the first frame along
    x."""
    with np.load(file) as data:
        names, index = tuple(map(str, data["common14"])), data["common14_idx"]
        step = max(1, round(float(data["fps"]) / CapturedTake.fps))
        up = json.loads(str(data["meta"])).get("up", "y")
        count = len(data["trial_ids"])
        motions = [data[f"trial_{k:02d}"][::step][:, index].astype(float) for k in range(count)]
    if up == "y":
        motions = [motion[..., [2, 0, 1]] for motion in motions]
    return [CapturedTake(_about_hips(motion, names), names) for motion in motions]


def _about_hips(
    joints: Float[np.ndarray, "T J 3"], names: tuple[str, ...]
) -> Float[np.ndarray, "T J 3"]:
    left, right = (joints[:, names.index(f"{side}_hip")] for side in "lr")
    x, y, _ = left[0] - right[0]
    turn = np.arctan2(y, x)
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray((joints - (left + right)[:, None] / 2) @ R.T)


def between_deg(
    a: Float[np.ndarray, "N 3"], b: Float[np.ndarray, "*N 3"]
) -> Float[np.ndarray, " N"]:
    """Angle between directions."""
    product = (a * b).sum(-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
    return np.rad2deg(np.arccos(np.clip(product, -1.0, 1.0)))
