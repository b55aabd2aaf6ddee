"""Template: the precision-weighted mean of the videos' poses at the reference's positions.

A monocular estimate is certain across its line of sight and uncertain along it. Videos look from
different sides, so depth of one is lateral for another: the mean weighs every direction of every
video's poses by its precision, which is what triangulation does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.banded import BandedMap
from imocap_core.sync.pairwise.rigid_alignment import centred, rotations_onto

# Inverse variances of a monocular estimate's camera axes, across and along the line of sight.
VIEW_PRECISION = np.array([1.0, 1.0, 0.1])
ISOTROPIC = np.ones(3)
LEAST_PRECISION = 1e-9  # of the mean precision: regularises joints that are visible in no video


@dataclass(frozen=True)
class TemplatePoses:
    """Poses at S positions of the reference, of one video or of several together.

    Attributes:
        poses: about their centroids, in the reference's axes.
        weights: of the joints, in [0, 1].
        precision: inverse covariance of each joint up to one factor, with the weights included.
    """

    poses: Float[np.ndarray, "S J 3"]
    weights: Float[np.ndarray, "S J"]
    precision: Float[np.ndarray, "S J 3 3"]


def isotropic_poses(
    poses: Float[np.ndarray, "S J 3"], weights: Float[np.ndarray, "S J"]
) -> TemplatePoses:
    """Poses with equal precision in all directions."""
    return TemplatePoses(poses, weights, weights[..., None, None] * np.eye(3))


def interpolated_poses(
    poses: Float[np.ndarray, "T J 3"], weights: Float[np.ndarray, "T J"], per_frame: int
) -> tuple[Float[np.ndarray, "S J 3"], Float[np.ndarray, "S J"]]:
    """Poses and weights at positions between frames, linear: S = (T - 1) per_frame + 1.

    Between a frame with a joint and a frame without, the visible one is taken.
    """
    position = np.arange((len(poses) - 1) * per_frame + 1) / per_frame
    low = np.minimum(position.astype(int), len(poses) - 1)
    high = np.minimum(low + 1, len(poses) - 1)
    share = (position - low)[:, None]
    a, b = weights[low] * (1 - share), weights[high] * share
    x = np.nan_to_num(poses)
    total = np.maximum(a + b, 1e-12)[..., None]
    mixed = (a[..., None] * x[low] + b[..., None] * x[high]) / total
    return mixed, np.minimum(a + b, 1.0)


def poses_of_reference(
    poses: Float[np.ndarray, "T J 3"],
    weights: Float[np.ndarray, "T J"],
    per_frame: int,
    axes: Float[np.ndarray, "3"],
) -> TemplatePoses:
    """The reference's poses at all positions, with inverse variances of its camera axes."""
    between, visible = interpolated_poses(poses, weights, per_frame)
    precision = visible[..., None, None] * np.diag(axes)
    return TemplatePoses(centred(between, visible), visible, precision)


def poses_of_video(
    poses: Float[np.ndarray, "N J 3"],
    weights: Float[np.ndarray, "N J"],
    soft_map: BandedMap,
    reference: TemplatePoses,
    axes: Float[np.ndarray, "3"],
    window: float,
) -> TemplatePoses:
    """A video's poses rotated onto the reference and spread over its positions by a soft map.

    Args:
        axes: inverse variances of the video's camera axes.
        window: frames, as in `rotations_onto`.
    """
    N, J, _ = poses.shape
    S = len(reference.poses)
    targets = soft_map.gathered(reference.poses.reshape(S, -1)).reshape(poses.shape)
    shared = weights * soft_map.gathered(reference.weights)
    x = centred(poses, shared)
    R = rotations_onto(x, centred(targets, shared), shared, window)
    frame_precision = (R * axes) @ R.swapaxes(1, 2)
    pull = np.einsum("nab,njb->nja", R * axes, x) * weights[..., None]
    total = soft_map.spread(weights)
    by_joint = (weights[..., None] * frame_precision.reshape(N, 1, 9)).reshape(N, -1)
    precision = soft_map.spread(by_joint).reshape(S, J, 3, 3)
    mean = _solved(precision, soft_map.spread(pull.reshape(N, -1)).reshape(S, J, 3))
    # several frames at one position count as one
    count = np.maximum(total, 1.0)[..., None, None]
    return TemplatePoses(mean, np.minimum(total, 1.0), precision / count)


def fused(parts: Sequence[TemplatePoses]) -> TemplatePoses:
    """The precision-weighted mean of several videos' poses."""
    precision = np.sum([p.precision for p in parts], axis=0)
    pull = np.sum([(p.precision @ p.poses[..., None])[..., 0] for p in parts], axis=0)
    total = np.sum([p.weights for p in parts], axis=0)
    return TemplatePoses(_solved(precision, pull), np.minimum(total, 1.0), precision)


def _solved(precision: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """precision^-1 pull (..., 3); 0 where the precision is 0."""
    mean = np.trace(precision, axis1=-2, axis2=-1).mean() / 3
    least = max(LEAST_PRECISION * float(mean), 1e-300) * np.eye(3)
    return np.asarray(np.linalg.solve(precision + least, pull[..., None])[..., 0])
