"""Squared distances of each video to the template made of the other videos.

The difference of two monocular estimates carries the noise of both. Once videos are roughly
synchronised, the others' poses, rotated onto the reference and averaged at each moment, are a
template with a fraction of it; never of the video itself, which would agree with its own noise.

Whitening: wrists err more than hips, and a limb errs as a whole, so a distance that adds up joints
alike counts one error several times. The residuals of the current alignment give the covariance of
the joints' errors, and features in which these are independent and equal. Combining joints commutes
with rotating poses, so alignment works on the features unchanged.

Camera axes: an estimate is far less certain along the line of sight, and its orientation drifts
slowly. Rigid alignment frame by frame spreads the error in depth over all directions. Once videos
are roughly synchronised the rotation to the template is a smooth function of time, and residuals
show how certain each axis is: the distance is then a plain weighted one, a matrix product.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.sync.comparable_poses import mean_of_known, spread_over, squared_differences
from imocap_core.sync.maps import Band, BandedMap
from imocap_core.sync.procrustes import centred, procrustes_distances, rotations_onto
from imocap_core.sync.warp.template import (
    ISOTROPIC,
    VIEW_PRECISION,
    NearbySquares,
    TemplatePoses,
    fused,
    poses_of_reference,
    poses_of_video,
)

OFF_DIAGONAL = 0.8  # shrinkage of the covariances between joints: residuals are few
LEAST_VARIANCE = 0.02  # of the mean variance: no feature counts more than fifty times the usual one


def whitening(
    residuals: Float[np.ndarray, "N J 3"], weights: Float[np.ndarray, "N J"]
) -> Float[np.ndarray, "J J"]:
    """Matrix that turns joints into features of equal, independent errors; the mean variance stays.

    Frames with large residuals count less. The identity where joints are missing in some frames: a
    combination of joints needs all of them.
    """
    J = residuals.shape[1]
    visible = (weights > 0).any(axis=1)
    complete = (
        np.isfinite(residuals[visible]).all() and (weights[visible] == weights[visible, :1]).all()
    )
    if visible.sum() < 3 * J or not complete:
        return np.eye(J)
    z = residuals[visible] * np.sqrt(axis_precisions(residuals, weights))
    size = (z * z).sum(axis=(1, 2))
    robust = 1.0 / (1.0 + size / max(float(np.median(size)), 1e-18))
    covariance = np.einsum("n,nja,nka->jk", robust, z, z) / (3.0 * robust.sum())
    diagonal = np.diag(np.diag(covariance))
    covariance = diagonal + OFF_DIAGONAL * (covariance - diagonal)
    mean = float(np.trace(covariance)) / J
    if not mean > 0:
        return np.eye(J)
    values, vectors = np.linalg.eigh(covariance / mean)
    return np.asarray((vectors / np.sqrt(values + LEAST_VARIANCE)) @ vectors.T)


@dataclass(frozen=True)
class TemplateAlignment:
    """A video's centred poses aligned with the moments of a template that its map assigns to them.

    Attributes:
        poses, template: both about their weighted centroids.
        R_template_from_video: rotation of each frame.
        residuals: poses less the assigned template poses, in the video's axes.
        weights: of the residuals.
    """

    poses: Float[np.ndarray, "N J 3"]
    template: Float[np.ndarray, "S J 3"]
    R_template_from_video: Float[np.ndarray, "N 3 3"]
    residuals: Float[np.ndarray, "N J 3"]
    weights: Float[np.ndarray, "N J"]


def align_with_template(
    poses: Float[np.ndarray, "N J 3"],
    weights: Float[np.ndarray, "N J"],
    template: Float[np.ndarray, "S J 3"],
    template_weights: Float[np.ndarray, "S J"],
    soft_map: BandedMap,
    window: float,
) -> TemplateAlignment:
    """Align each frame of a video with its mean counterpart in a template.

    Args:
        soft_map: current position of the frames in the template (N, S); each row of any scale.
        window: frames, as in `rotations_onto`.
    """
    S = soft_map.shape[1]
    x, y = centred(poses, weights), centred(template, template_weights)
    total = np.maximum(soft_map.row_sums(), 1e-12)[:, None]
    targets = (soft_map.gathered(y.reshape(S, -1)) / total).reshape(x.shape)
    both = weights * (soft_map.gathered(template_weights) / total)
    R = rotations_onto(x, targets, both, window)
    residuals = x - np.einsum("nab,nja->njb", R, targets)
    return TemplateAlignment(x, y, R, np.asarray(residuals), both)


def axis_precisions(
    residuals: Float[np.ndarray, "N J 3"], weights: Float[np.ndarray, "N J"]
) -> Float[np.ndarray, "3"]:
    """Precision (inverse variance, mean 1) of each camera axis, from residuals.

    The variances are squared medians of absolute residuals, robust to outliers; no axis counts
    more than ten times another.
    """
    valid = residuals[weights > 0]
    if len(valid) == 0:
        return np.ones(3)
    variance = np.median(np.abs(valid), axis=0) ** 2
    precision = 1.0 / np.maximum(variance, max(0.1 * float(variance.max()), 1e-18))
    return np.asarray(precision * 3.0 / precision.sum())


def squared_view_distances(
    poses: Float[np.ndarray, "N J 3"],
    weights: Float[np.ndarray, "N J"],
    template: Float[np.ndarray, "S J 3"],
    template_weights: Float[np.ndarray, "S J"],
    soft_map: BandedMap,
    window: float,
) -> Callable[[slice, slice], Float[np.ndarray, "_n _s"]]:
    """Mean squared joint distance of a video's frames to a template, in the video's axes: a
    function of frames and positions.

    Arguments as of `align_with_template`. NaN where no joint is shared.
    """
    aligned = align_with_template(poses, weights, template, template_weights, soft_map, window)
    N, S = soft_map.shape
    x, y, R = aligned.poses, aligned.template, aligned.R_template_from_video
    precision = axis_precisions(aligned.residuals, aligned.weights)

    # (x - R'y)' P (x - R'y) = x'Px - 2 (RPx)'y + y'(RPR')y, summed over the shared joints
    RPR = np.einsum("nab,b,ncb->nac", R, precision, R)
    RPx = np.einsum("nab,njb->nja", R * precision, x) * weights[..., None]
    yy = np.einsum("sja,sjb->sjab", y, y) * template_weights[..., None, None]
    xPx = weights * (x * x * precision).sum(axis=-1)
    by_y, by_yy = RPx.reshape(N, -1), (weights[..., None] * RPR.reshape(N, 1, 9)).reshape(N, -1)
    weighted_y, yy = (y * template_weights[..., None]).reshape(S, -1), yy.reshape(S, -1)

    def squares(frames: slice, positions: slice) -> np.ndarray:
        square = xPx[frames] @ template_weights[positions].T
        square -= 2.0 * by_y[frames] @ weighted_y[positions].T
        square += by_yy[frames] @ yy[positions].T
        shared = weights[frames] @ template_weights[positions].T
        mean = np.maximum(square, 0.0) / np.where(shared > 0, shared, 1.0)
        return np.where(shared > 0, mean, np.nan)

    return squares


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
