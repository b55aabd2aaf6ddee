"""Pairwise agreement of hypotheses: one rotation and one warp must explain both videos' keypoints.

Under the rotation from video a to video b, a's motion is projected onto b's keypoints, and, under
its inverse, b's motion onto a's. Each direction by itself is blind to depth: reversed in a, it is
made good by a rotation the other way. Both together under one rotation are not, unless the two
videos look along one line. Keypoints are the evidence, so a wrong motion cannot vouch for another
beyond what the pictures show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from imocap_core.sync.screening.registration import (
    Keypoints2D,
    camera_directions,
    pose_residuals,
    residual_share,
    warp_costs,
    warp_path,
)

DIRECTIONS = 96
STEPS_DEG = (8.0, 4.0, 2.0)  # of the rotation's refinement
TURNS = np.concatenate([np.eye(3), -np.eye(3)])


@dataclass(frozen=True)
class Hypothesis3D:
    """A motion of one video, in the axes of its own camera (y down), and keypoints of its joints at
    the same frames: as detected, or with the sides swapped that the motion says are."""

    motion: Float[np.ndarray, "T J 3"]
    keypoints: Keypoints2D

    def every(self, n: int) -> Hypothesis3D:
        """Every n-th frame."""
        return self.at(np.arange(0, len(self.motion), n))

    def at(self, frames: Int[np.ndarray, " N"]) -> Hypothesis3D:
        """Some frames, in any order."""
        k = self.keypoints
        return Hypothesis3D(self.motion[frames], Keypoints2D(k.xy_px[frames], k.weight[frames]))


def pair_costs(
    a: Sequence[Hypothesis3D], b: Sequence[Hypothesis3D]
) -> Float[np.ndarray, "K_a K_b"]:
    """Mean residual of both videos' keypoints for each pair of hypotheses, 0 to 1."""
    forth = camera_directions(DIRECTIONS)
    R_b_from_a = np.concatenate([forth, np.cross(forth[:, :1], forth[:, 1:])], axis=1)
    back = R_b_from_a.transpose(0, 2, 1)[:, :2]
    frames = np.arange(len(b[0].motion))
    costs = np.zeros((len(a), len(b)))
    residuals: dict[tuple[int, int, int], np.ndarray] = {}

    def onto(of: Hypothesis3D, other: Hypothesis3D, axes: np.ndarray) -> np.ndarray:
        """(D, T_other, T_of); hypotheses of one video mostly share their keypoints."""
        key = (id(of.motion), id(other.keypoints), id(axes))
        if key not in residuals:
            residuals[key] = pose_residuals(of.motion, other.keypoints, axes)
        return residuals[key]

    for i, j in np.ndindex(costs.shape):
        both = 0.5 * (onto(a[i], b[j], forth) + onto(b[j], a[i], back).transpose(0, 2, 1))
        totals = warp_costs(both)
        best = int(totals.argmin())
        path = warp_path(both[best])
        steps = float(totals[best] - both[best][frames, path].sum())
        costs[i, j] = refined_residual(R_b_from_a[best], a[i].at(path), b[j]) + steps / len(frames)
    return costs


def refined_residual(
    R_b_from_a: Float[np.ndarray, "3 3"], a: Hypothesis3D, b: Hypothesis3D
) -> float:
    """Mean residual of two videos' matched frames at a local minimum of the rotation."""

    def residuals(R: Float[np.ndarray, "D 3 3"]) -> Float[np.ndarray, " D"]:
        forth = _matched_residuals(a.motion, b.keypoints, R)
        return 0.5 * (forth + _matched_residuals(b.motion, a.keypoints, R.transpose(0, 2, 1)))

    R, residual = R_b_from_a, float(residuals(R_b_from_a[None])[0])
    for step_deg in STEPS_DEG:
        turns = Rotation.from_rotvec(TURNS * np.deg2rad(step_deg)).as_matrix()
        while True:
            near = residuals(turns @ R)
            if near.min() >= residual:
                break
            R, residual = turns[near.argmin()] @ R, float(near.min())
    return residual


def _matched_residuals(
    motion: Float[np.ndarray, "T J 3"], keypoints: Keypoints2D, R: Float[np.ndarray, "D 3 3"]
) -> Float[np.ndarray, " D"]:
    """Mean over the frames of what each rotated pose leaves of its own frame's keypoints."""
    share = keypoints.weight / np.maximum(keypoints.weight.sum(1, keepdims=True), 1e-12)
    given = np.where(keypoints.weight[..., None] > 0, keypoints.xy_px, 0.0)
    x, p = (q - np.einsum("tk,tki->ti", share, q)[:, None] for q in (given, motion))
    cross = np.einsum("tk,tki,tkj->ijt", share, x, p).reshape(6, -1)
    moment = np.einsum("tk,tki,tkj->ijt", share, p, p).reshape(9, -1)
    axes = R[:, :2]
    product = axes.reshape(-1, 6) @ cross
    spread = np.einsum("dai,daj->dij", axes, axes).reshape(-1, 9) @ moment
    size = np.einsum("tk,tki->t", share, x**2)
    return residual_share(product, spread, size).mean(axis=1)
