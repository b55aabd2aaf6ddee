"""Squared distances of each video to the template made of the other videos.

The difference of two monocular estimates carries the noise of both. Once the videos are roughly
synchronised, the other videos' poses, rotated onto the reference and averaged at each moment, are a
template with a fraction of that noise; each video is warped onto the template made of the others
(never of itself: it would agree with its own noise).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.banded import Band, BandedMap
from imocap_core.sync.pairwise.procrustes import procrustes_distances
from imocap_core.sync.pairwise.rigid_alignment import centred
from imocap_core.sync.pairwise.vertical_motion import (
    mean_of_known,
    spread_over,
    squared_differences,
)
from imocap_core.sync.pairwise.view_distance import align_with_template, squared_view_distances
from imocap_core.sync.pairwise.whitening import whitening
from imocap_core.sync.warp.nearby_squares import NearbySquares
from imocap_core.sync.warp.template import (
    ISOTROPIC,
    VIEW_PRECISION,
    TemplatePoses,
    fused,
    poses_of_reference,
    poses_of_video,
)


def squared_distances_to_others(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    soft_maps: Sequence[BandedMap | None],
    nearby: Sequence[Sequence[Band]],
    reference: int,
    per_frame: int,
    windows: Sequence[float] | None,
    vertical: Sequence[Float[np.ndarray, "_T"]],
) -> Iterator[tuple[int, NearbySquares]]:
    """Of every video but the reference, one after another: squared distances of its frames to the
    template made of all other videos.

    Args:
        soft_maps: into the reference's positions, rows scaled by how much the frame counts; None
            for the reference.
        nearby: per video, the positions near those of its map.
        per_frame: positions per frame of the reference.
        windows: frames over which each video's orientation changes. With them, poses are compared
            in each video's camera axes and whitened joints; without, by their Procrustes distance.
        vertical: per video, its vertical motion.
    """
    axes = ISOTROPIC if windows is None else VIEW_PRECISION
    base = poses_of_reference(poses[reference], weights[reference], per_frame, axes)
    parts = [
        base if p is None else poses_of_video(x, w, p, base, axes, windows[v] if windows else 0.0)
        for v, (x, w, p) in enumerate(zip(poses, weights, soft_maps, strict=True))
    ]
    lifted = [spread_over(h, p, per_frame) for h, p in zip(vertical, soft_maps, strict=True)]
    for v, soft_map in enumerate(soft_maps):
        if soft_map is None:
            continue
        others = fused([part for u, part in enumerate(parts) if u != v])
        if windows is None:
            squares = _procrustes_squares(poses[v], weights[v], others)
        else:
            squares = _squares_of_features(poses[v], weights[v], others, soft_map, windows[v])
        height = mean_of_known([h for u, h in enumerate(lifted) if u != v])
        squares = _with_heights(squares, vertical[v], height)
        yield v, NearbySquares.computed(soft_map.shape, nearby[v], squares)


def _with_heights(
    squares: Callable[[slice, slice], np.ndarray], vertical: np.ndarray, others: np.ndarray
) -> Callable[[slice, slice], np.ndarray]:
    """Squared distances of poses and of heights, of frames and positions."""

    def both(frames: slice, positions: slice) -> np.ndarray:
        lifted = squared_differences(vertical[frames], others[positions])
        return np.asarray(squares(frames, positions) + lifted)

    return both


def _procrustes_squares(
    poses: np.ndarray, weights: np.ndarray, template: TemplatePoses
) -> Callable[[slice, slice], np.ndarray]:
    """Squared Procrustes distances, of frames and positions."""

    def squares(frames: slice, positions: slice) -> np.ndarray:
        others, visible = template.poses[positions], template.weights[positions]
        return procrustes_distances(poses[frames], others, weights[frames], visible) ** 2

    return squares


def _squares_of_features(
    poses: np.ndarray,
    weights: np.ndarray,
    template: TemplatePoses,
    soft_map: BandedMap,
    window: float,
) -> Callable[[slice, slice], np.ndarray]:
    """Squared distances in the video's axes between whitened joints, of frames and positions."""
    y, y_weights = template.poses, template.weights
    residuals = align_with_template(poses, weights, y, y_weights, soft_map, window).residuals
    W = whitening(residuals, weights)
    x, y = centred(poses, weights), centred(y, y_weights)
    return squared_view_distances(W @ x, weights, W @ y, y_weights, soft_map, window)
