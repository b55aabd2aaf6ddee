"""Warps refined against what the other videos agree on.

Two single estimates compared carry the noise of both. Once the videos are roughly synchronised,
the other videos' poses, turned onto the reference and averaged at each moment, are a template with
a fraction of that noise; each video is warped onto the template made of the others (never of
itself: it would agree with its own noise).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.pairwise.affinity import procrustes_distances
from imocap_core.sync.pairwise.view_axes import centred, squared_distances_in_view
from imocap_core.sync.pairwise.whitening import residuals_in_view, whitening
from imocap_core.sync.warp.template import (
    ALIKE,
    IN_VIEW,
    Contribution,
    contribute,
    of_reference,
    template,
)

Array = NDArray[np.float64]


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
    axes = ALIKE if windows is None else IN_VIEW
    base = of_reference(poses[reference], weights[reference], per_frame, axes)
    parts = [
        base if p is None else contribute(x, w, p, base, axes, windows[v] if windows else 0.0)
        for v, (x, w, p) in enumerate(zip(poses, weights, maps, strict=True))
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
