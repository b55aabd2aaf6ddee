"""The best camera and warp of a video's keypoints under a motion, beyond fixed directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Int

from imocap_core.camera.rotation_search import refined_rotation
from imocap_core.sync.screening.registration import (
    Keypoints2D,
    best_warp,
    centred_plane,
    pose_residuals,
    residual_share,
    warp_costs,
)

SWAPPED = 0.1  # residual that a frame costs whose left and right are taken as swapped
FITTING_SHARE = 0.8  # of the frames, in which change is compared
TURNS_DEG = (10.0, 5.0, 2.5)  # of the best direction's refinement


@dataclass(frozen=True)
class Registration:
    """The camera and the warp under which a motion explains a video's keypoints best.

    Attributes:
        residual: mean a frame, costs of the warp included, 0 (explained) to 1.
        static_residual: the same of the motion's best single pose, held throughout.
        explained_change: of the keypoints over time; about 0 where chance alone matches them.
        axes: image axes (right, down) in the motion's axes.
        frames: (T,) of the motion.
    """

    residual: float
    static_residual: float
    explained_change: float
    axes: Float[np.ndarray, "2 3"]
    frames: Int[np.ndarray, " T"]


def registered(
    motion: Float[np.ndarray, "N J 3"],
    keypoints: Keypoints2D,
    directions: Float[np.ndarray, "D 2 3"],
) -> Registration:
    """The best of some directions, refined, and its warp."""
    plane, weight = centred_plane(keypoints), keypoints.weight
    residuals = pose_residuals(motion, keypoints, directions)
    best = int(warp_costs(residuals).argmin())
    frames = best_warp(residuals[best])[1]
    poses = np.nan_to_num(motion)[frames]
    start = np.concatenate([directions[best], np.cross(*directions[best])[None]])
    R, _ = refined_rotation(
        start, lambda near: _aligned_residuals(poses, plane, weight, near[:, :2]), TURNS_DEG
    )
    axes = R[:2]
    refined = pose_residuals(motion, keypoints, axes[None])
    cost, frames = best_warp(refined[0])
    change = explained_change(np.nan_to_num(motion)[frames] @ axes.T, plane, weight)
    static = float(residuals.mean(axis=1).min())
    return Registration(cost / len(frames), static, change, axes, frames)


def explained_change(
    projected: Float[np.ndarray, "T J 2"],
    plane: Complex[np.ndarray, "T J"],
    weight: Float[np.ndarray, "T J"],
) -> float:
    """Coefficient of determination of the keypoints' change over time, at most 1.

    Keypoints and projected poses are scaled and placed alike in every frame and taken about each
    joint's mean over time, so what a motion has wrong throughout, such as its depth, costs nothing.
    Of both the frames that lie farthest out do not count: stretches that are detected badly, or
    that only this video shows.

    Args:
        plane: the keypoints about each frame's mean (`centred_plane`).
    """
    visible = weight.sum(axis=1) > 0
    x, w = plane[visible], weight[visible]
    total = w.sum(axis=1, keepdims=True)
    pose = projected[visible, :, 0] + 1j * projected[visible, :, 1]
    pose = pose - (w * pose).sum(1, keepdims=True) / total
    spread = np.maximum((w * np.abs(pose) ** 2).sum(1, keepdims=True), 1e-12)
    scale = np.maximum((w * (x.conj() * pose).real).sum(1, keepdims=True), 0.0) / spread
    size = np.sqrt(np.maximum((w * np.abs(x) ** 2).sum(1, keepdims=True) / total, 1e-12))
    if not len(x):
        return 0.0
    return 1.0 - _change((x - scale * pose) / size, w) / max(_change(x / size, w), 1e-12)


def _change(values: Complex[np.ndarray, "T J"], weight: Float[np.ndarray, "T J"]) -> float:
    """Mean square about each joint's mean over time, of the FITTING_SHARE of frames next to it."""
    mean = (weight * values).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-12)
    square = (weight * np.abs(values - mean) ** 2).sum(axis=1) / weight.sum(axis=1)
    return float(np.sort(square)[: max(1, round(FITTING_SHARE * len(square)))].mean())


def sides_corrected(
    motion: Float[np.ndarray, "N J 3"],
    keypoints: Keypoints2D,
    directions: Float[np.ndarray, "D 2 3"],
    twins: Sequence[int],
) -> tuple[Keypoints2D, float]:
    """The keypoints with left and right swapped where that fits a motion clearly better.

    Also what the swap costs, mean a frame: a detector that takes the back for the front.
    """
    columns = list(twins)
    other = Keypoints2D(keypoints.xy_px[:, columns], keypoints.weight[:, columns])
    as_given, other_sides = (pose_residuals(motion, k, directions) for k in (keypoints, other))
    least = np.minimum(as_given, other_sides + SWAPPED)
    best = int(warp_costs(least).argmin())
    frames = best_warp(least[best])[1]
    rows = np.arange(len(frames))
    swapped = (other_sides[best] + SWAPPED < as_given[best])[rows, frames]
    corrected = Keypoints2D(
        np.where(swapped[:, None, None], other.xy_px, keypoints.xy_px),
        np.where(swapped[:, None], other.weight, keypoints.weight),
    )
    return corrected, SWAPPED * float(swapped.mean())


def _aligned_residuals(
    poses: Float[np.ndarray, "T J 3"],
    plane: Complex[np.ndarray, "T J"],
    weight: Float[np.ndarray, "T J"],
    directions: Float[np.ndarray, "D 2 3"],
) -> Float[np.ndarray, " D"]:
    """Mean of `pose_residuals` over frames whose poses correspond."""
    projected = np.einsum("dij,tkj->ditk", directions, poses)
    pose = projected[:, 0] + 1j * projected[:, 1]
    total = np.maximum(weight.sum(1), 1e-12)
    pose = pose - ((weight * pose).sum(2) / total)[..., None]
    product = (weight * (plane.conj() * pose).real).sum(2)
    spread = (weight * np.abs(pose) ** 2).sum(2)
    size = (weight * np.abs(plane) ** 2).sum(1)
    return np.asarray(residual_share(product, spread, size).mean(axis=1))
