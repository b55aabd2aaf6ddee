"""Warps refined against what the other videos agree on.

Two single estimates compared carry the noise of both. Once the videos are roughly synchronised,
the other videos' poses, turned onto the reference and averaged at each moment, are a template with
a fraction of that noise; each video is warped onto the template made of the others (never of
itself: it would agree with its own noise).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.affinity import procrustes_distances
from imocap_core.sync.view_axes import centred, rotations_onto, squared_distances_in_view
from imocap_core.sync.whitening import residuals_in_view, whitening

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Contribution:
    """One video's poses on the positions of the reference: poses (S, J, 3), weights (S, J) in [0,
    1]."""

    poses: Array
    weights: Array


def positions_between(poses: Array, weights: Array, per_frame: int) -> Contribution:
    """The reference itself at positions between its frames, linearly interpolated: S = (T - 1)
    per_frame + 1."""
    at = np.arange((len(poses) - 1) * per_frame + 1) / per_frame
    low = np.minimum(at.astype(int), len(poses) - 1)
    high = np.minimum(low + 1, len(poses) - 1)
    share = (at - low)[:, None]
    a, b = weights[low] * (1 - share), weights[high] * share
    x = np.nan_to_num(poses)
    total = np.maximum(a + b, 1e-12)[..., None]
    mixed = (a[..., None] * x[low] + b[..., None] * x[high]) / total
    # between a frame that sees a joint and one that doesn't the seen one stands in
    return Contribution(mixed, np.minimum(a + b, 1.0))


def turned_onto(poses: Array, targets: Array, weights: Array) -> Array:
    """Each pose (n, J, 3) centred and turned rigidly onto its target; `weights` (n, J) of
    joints."""
    a = centred(poses, weights)
    R = rotations_onto(a, centred(targets, weights), weights)
    turned: Array = np.einsum("nab,njb->nja", R, a)
    return turned


def contribute(poses: Array, weights: Array, maps: Array, base: Contribution) -> Contribution:
    """Spread a video's frames over the reference's positions by its soft map (n, S), turned onto
    the reference."""
    targets = (maps @ base.poses.reshape(len(base.poses), -1)).reshape(poses.shape)
    seen = weights * (maps @ base.weights)
    x = turned_onto(poses, targets, seen)
    n, J, _ = x.shape
    total = maps.T @ weights
    mixed = (maps.T @ (weights[..., None] * x).reshape(n, -1)).reshape(-1, J, 3)
    return Contribution(mixed / np.maximum(total, 1e-9)[..., None], np.minimum(total, 1.0))


def template(parts: Sequence[Contribution]) -> Contribution:
    """The weighted mean of several contributions."""
    total = np.sum([p.weights for p in parts], axis=0)
    mixed = np.sum([p.weights[..., None] * p.poses for p in parts], axis=0)
    return Contribution(mixed / np.maximum(total, 1e-9)[..., None], np.minimum(total, 1.0))


def squared_distances_to_others(
    poses: Sequence[Array],
    weights: Sequence[Array],
    maps: Sequence[Array | None],
    reference: int,
    per_frame: int,
    windows: Sequence[float] | None,
) -> list[Array | None]:
    """Per video (T_v, S): squared distance of its frames to the template made of all
    other videos.

    With `windows` (frames) poses are compared in each video's own axes and its joints by how surely
    they are known. `maps` (T_v, S) soft maps into the reference's positions, rows scaled by how
    much the video counts; None for the reference, and None in the answer.
    """
    base = positions_between(poses[reference], weights[reference], per_frame)
    base = Contribution(centred(base.poses, base.weights), base.weights)
    parts = [
        base if p is None else contribute(x, w, p, base)
        for x, w, p in zip(poses, weights, maps, strict=True)
    ]
    squares: list[Array | None] = []
    for v, p in enumerate(maps):
        if p is None:
            squares.append(None)
            continue
        others = template([part for u, part in enumerate(parts) if u != v])
        x, w = poses[v], weights[v]
        if windows is None:
            squares.append(procrustes_distances(x, others.poses, w, others.weights) ** 2)
        else:
            squares.append(_squares_of_features(x, w, others, p, windows[v]))
    return squares


def _squares_of_features(
    poses: Array, weights: Array, others: Contribution, maps: Array, window: float
) -> Array:
    """Distances in the video's axes between features whose errors are independent."""
    residuals = residuals_in_view(poses, weights, others.poses, others.weights, maps, window)
    W = whitening(residuals, weights)
    x, y = centred(poses, weights), centred(others.poses, others.weights)
    return squared_distances_in_view(W @ x, weights, W @ y, others.weights, maps, window)
