"""Common motion of several videos: their keypoints, linearly triangulated (scaled orthographic).

One video's monocular motion, in its own camera's axes, gives the time and a weak prior of every
joint. The other videos' keypoints are registered with it, which tells each camera's direction, the
corresponding frames, and each frame's scale and place; then every joint at every moment is a linear
least-squares problem of three unknowns. A second round registers with the motion of the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
from jaxtyping import Float

from imocap_core.sync.screening.best_camera import Registration, registered
from imocap_core.sync.screening.registration import Keypoints2D

PRIOR = 0.3  # weight of the monocular motion's joints; a visible keypoint weighs up to 1
ROUNDS = 2
IMAGE_AXES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # right, down of a camera in its own axes


@dataclass(frozen=True)
class NormalMatrices:
    """Normal equations of every joint at every moment."""

    matrix: Float[np.ndarray, "N J 3 3"]
    right_side: Float[np.ndarray, "N J 3"]

    def __add__(self, other: NormalMatrices) -> NormalMatrices:
        return NormalMatrices(self.matrix + other.matrix, self.right_side + other.right_side)

    def solved(self) -> Float[np.ndarray, "N J 3"]:
        """The joints."""
        return np.asarray(np.linalg.solve(self.matrix, self.right_side[..., None])[..., 0])


def motions_without(
    motions: Sequence[Float[np.ndarray, "_ J 3"]],
    keypoints: Sequence[Keypoints2D],
    residuals: Float[np.ndarray, "M M"],
    directions: Float[np.ndarray, "D 2 3"],
) -> list[Float[np.ndarray, "_ J 3"]]:
    """For every video the common motion of all others.

    Args:
        motions, keypoints: of two videos or more, none of them a mirror image of another.
        residuals: of video j's keypoints with video i's motion (`registration_residual`).
    """
    every = list(range(len(motions)))
    first = _central(every, residuals)
    rest = [v for v in every if v != first]
    second = _central(rest, residuals)
    common: dict[int, np.ndarray] = {}
    for reference, members, left_out in ((first, every, rest), (second, rest, [first])):
        others = [v for v in members if v != reference]
        parts = _parts(reference, others, motions, keypoints, residuals, directions)
        for v in left_out:
            common[v] = _total([part for u, part in parts.items() if u != v]).solved()
    return [common[v] for v in every]


def _total(parts: Sequence[NormalMatrices]) -> NormalMatrices:
    return reduce(add, parts)


def _central(videos: Sequence[int], residuals: Float[np.ndarray, "M M"]) -> int:
    """The video whose motion explains the others' keypoints best."""
    totals = {v: sum(residuals[v, u] for u in videos if u != v) for v in videos}
    return min(totals, key=lambda v: totals[v])


def _parts(
    reference: int,
    others: Sequence[int],
    motions: Sequence[np.ndarray],
    keypoints: Sequence[Keypoints2D],
    residuals: Float[np.ndarray, "M M"],
    directions: np.ndarray,
) -> dict[int, NormalMatrices]:
    """What each video adds to the normal equations, the reference's prior included."""
    joints = np.nan_to_num(motions[reference])
    motion = joints - joints.mean(axis=1, keepdims=True)
    own_view = Registration(0.0, 1.0, 1.0, IMAGE_AXES, np.arange(len(motion)))
    eye = np.broadcast_to(PRIOR * np.eye(3), (*motion.shape[:2], 3, 3))
    fixed = NormalMatrices(eye, PRIOR * motion)
    fixed += _normal_matrices(motion, keypoints[reference], own_view, 1.0)
    least = min((residuals[reference, u] for u in others), default=1.0)
    parts = {reference: fixed}
    for _ in range(ROUNDS):
        for u in others:
            view = registered(motion, keypoints[u], directions)
            weight = float((least / max(residuals[reference, u], 1e-9)) ** 2)
            parts[u] = _normal_matrices(motion, keypoints[u], view, weight)
        motion = _total(list(parts.values())).solved()
    return parts


def _normal_matrices(
    motion: Float[np.ndarray, "N J 3"], keypoints: Keypoints2D, view: Registration, share: float
) -> NormalMatrices:
    """Normal equations of one video's keypoints, scaled and placed like the projected motion."""
    weight, axes = keypoints.weight, view.axes
    projected = motion[view.frames] @ axes.T
    total = np.maximum(weight.sum(1), 1e-12)[:, None, None]
    w = weight[..., None]
    given = np.where(w > 0, keypoints.xy_px, 0.0)
    x = np.where(w > 0, given - (w * given).sum(1, keepdims=True) / total, 0.0)
    middle = (w * projected).sum(1, keepdims=True) / total
    p = projected - middle
    product, spread = (w * x * p).sum((1, 2)), (w * p * p).sum((1, 2))
    scale = np.maximum(product, 1e-9) / np.maximum(spread, 1e-9)
    placed = x / np.maximum(scale, 1e-6)[:, None, None] + middle
    repeats = np.bincount(view.frames, minlength=len(motion))[view.frames]
    weight = share * weight / np.maximum(repeats, 1)[:, None]
    matrix, right_side = np.zeros((*motion.shape, 3)), np.zeros(motion.shape)
    np.add.at(matrix, view.frames, weight[..., None, None] * (axes.T @ axes))
    np.add.at(right_side, view.frames, weight[..., None] * (placed @ axes))
    return NormalMatrices(matrix, right_side)
