"""What each video says of the poses at the reference's positions, and what all say together.

A monocular estimate is sure across its line of sight and guesses along it. Videos look from
different sides, so where one guesses another sees: the mean weighs every direction of every
video's poses by how surely it is known, which is what triangulation does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.pairwise.view_axes import centred, rotations_onto

Array = NDArray[np.float64]

# Inverse variances of a monocular estimate's camera axes, across and along the line of sight.
IN_VIEW = np.array([1.0, 1.0, 0.1])
ALIKE = np.ones(3)
LEAST = 1e-9  # of the precision: joints that nobody sees lie anywhere


@dataclass(frozen=True)
class Contribution:
    """Poses on S positions of the reference: poses (S, J, 3), weights (S, J) in [0, 1], and how
    surely every direction is known, precision (S, J, 3, 3), the weights counted in."""

    poses: Array
    weights: Array
    precision: Array


def alike(poses: Array, weights: Array) -> Contribution:
    """Poses whose directions are all known as surely."""
    return Contribution(poses, weights, weights[..., None, None] * np.eye(3))


def positions_between(poses: Array, weights: Array, per_frame: int) -> tuple[Array, Array]:
    """Poses (S, J, 3) and weights (S, J) of the reference itself at positions between its frames,
    linearly interpolated: S = (T - 1) per_frame + 1."""
    at = np.arange((len(poses) - 1) * per_frame + 1) / per_frame
    low = np.minimum(at.astype(int), len(poses) - 1)
    high = np.minimum(low + 1, len(poses) - 1)
    share = (at - low)[:, None]
    a, b = weights[low] * (1 - share), weights[high] * share
    x = np.nan_to_num(poses)
    total = np.maximum(a + b, 1e-12)[..., None]
    mixed = (a[..., None] * x[low] + b[..., None] * x[high]) / total
    # between a frame that sees a joint and one that doesn't the seen one stands in
    return mixed, np.minimum(a + b, 1.0)


def of_reference(poses: Array, weights: Array, per_frame: int, axes: Array) -> Contribution:
    """The reference's own, with inverse variances (3,) of its axes."""
    between, there = positions_between(poses, weights, per_frame)
    return Contribution(centred(between, there), there, there[..., None, None] * np.diag(axes))


def contribute(
    poses: Array, weights: Array, maps: Array, base: Contribution, axes: Array, window: float
) -> Contribution:
    """Spread a video's frames over the reference's positions by its soft map (n, S), turned onto
    the reference.

    Args:
        axes: (3,) inverse variances of the video's axes. window: frames, as in `rotations_onto`.
    """
    n, J, _ = poses.shape
    S = len(base.poses)
    targets = (maps @ base.poses.reshape(S, -1)).reshape(poses.shape)
    seen = weights * (maps @ base.weights)
    x = centred(poses, seen)
    R = rotations_onto(x, centred(targets, seen), seen, window)
    sure = (R * axes) @ R.swapaxes(1, 2)
    pull = np.einsum("nab,njb->nja", R * axes, x) * weights[..., None]
    total = maps.T @ weights
    by_joint = (weights[..., None] * sure.reshape(n, 1, 9)).reshape(n, -1)
    precision = (maps.T @ by_joint).reshape(S, J, 3, 3)
    mixed = _solved(precision, (maps.T @ pull.reshape(n, -1)).reshape(S, J, 3))
    often = np.maximum(total, 1.0)[..., None, None]
    return Contribution(mixed, np.minimum(total, 1.0), precision / often)


def template(parts: Sequence[Contribution]) -> Contribution:
    """The mean of several contributions, every direction weighted by its precision."""
    precision = np.sum([p.precision for p in parts], axis=0)
    pull = np.sum([(p.precision @ p.poses[..., None])[..., 0] for p in parts], axis=0)
    total = np.sum([p.weights for p in parts], axis=0)
    return Contribution(_solved(precision, pull), np.minimum(total, 1.0), precision)


def _solved(precision: Array, pull: Array) -> Array:
    """(..., 3) of precisions (..., 3, 3) and what they multiply; 0 where nothing is known."""
    mean = np.trace(precision, axis1=-2, axis2=-1).mean() / 3
    least = max(LEAST * float(mean), 1e-300) * np.eye(3)
    return np.asarray(np.linalg.solve(precision + least, pull[..., None])[..., 0])
