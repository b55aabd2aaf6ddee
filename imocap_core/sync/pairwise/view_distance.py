"""Distances between poses weighted by the certainty of each camera axis.

A monocular estimate is far less certain along the line of sight than across it, and its orientation
drifts slowly. Rigid alignment frame by frame can use neither fact: it spreads the error in depth
over all directions and leaves every frame's rotation free. Once a video is roughly synchronised,
the rotation between it and the template is a smooth function of time, and the residuals show how
certain each of its axes is. Given both, the distance is a plain weighted one, a matrix product.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.sync.pairwise.banded import BandedMap
from imocap_core.sync.pairwise.rigid_alignment import centred, rotations_onto


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
