"""Reprojection evidence: each frame's keypoints against the projected motion of the other videos.

For synchronisation once the cameras are estimated. Poses that were estimated with some
correspondences agree with these, so comparing the poses again confirms them. Detections do not
depend on correspondences: here every frame's keypoints are compared with the projections of the
other videos' motion at every moment, and the moment of the smallest error is its counterpart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from imocap_core.robust import geman_mcclure
from imocap_core.sync.maps import Band, BandedMap
from imocap_core.sync.warp.template import (
    OFFSET,
    OFFSET_FLOOR,
    OFFSET_START,
    NearbySquares,
    TemplatePoses,
    fused,
    interpolated_poses,
    isotropic_poses,
    median_positions,
    squares_after_offsets,
)

ROUNDS = 4  # of iteratively reweighted least squares
OUTLIER_SIGMA = 4.0  # scale of the Geman-McClure weights
LARGEST_SQUARE = 2.25  # of the assumed detector variance: 1.5 times the assumed noise


@dataclass(frozen=True)
class CalibratedVideo:
    """A video with its camera, detections and current 3D estimate.

    Attributes:
        xyz_m: its performer's keypoints in the common world, the current estimate.
        xy_px: detections, any value where missing.
        weight: of the detections, 1/px^2, 0 where missing.
        K: camera matrix. R, t: camera from the common world.
    """

    xyz_m: Float[np.ndarray, "T K 3"]
    xy_px: Float[np.ndarray, "T K 2"]
    weight: Float[np.ndarray, "T K"]
    K: Float[np.ndarray, "3 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class ProjectedTemplate:
    """S moments of a template projected into one camera.

    Attributes:
        xy_px: the projections.
        by_offset: their derivatives by a rigid offset: a rotation about the body's centre, rad,
            and a translation, m.
    """

    xy_px: Float[np.ndarray, "S K 2"]
    by_offset: Float[np.ndarray, "S K 2 6"]


def leave_one_out_motion(
    videos: Sequence[CalibratedVideo],
    soft_maps: Sequence[BandedMap],
    without: int,
    reference: int,
    per_frame: int,
) -> Float[np.ndarray, "S K 3"]:
    """Mean motion of all videos but one at the positions of the reference.

    Args:
        soft_maps: per video, into the reference's positions (T, S).
        without: the video left out.
        per_frame: positions per frame of the reference.
    """
    parts: list[TemplatePoses] = []
    for u, (video, soft_map) in enumerate(zip(videos, soft_maps, strict=True)):
        if u == without:
            continue
        ones = np.ones(video.xyz_m.shape[:2])
        if u == reference:
            parts.append(isotropic_poses(*interpolated_poses(video.xyz_m, ones, per_frame)))
            continue
        total = soft_map.spread(ones)[..., None]
        flat = soft_map.spread(video.xyz_m.reshape(len(ones), -1))
        mean = flat.reshape(-1, *video.xyz_m.shape[1:]) / np.maximum(total, 1e-9)
        parts.append(isotropic_poses(mean, np.minimum(per_frame * total[..., 0], 1.0)))
    return fused(parts).poses


def projected(xyz_m: Float[np.ndarray, "S K 3"], video: CalibratedVideo) -> ProjectedTemplate:
    """Project a motion into a video's camera."""
    centre = xyz_m.mean(axis=1, keepdims=True)
    x = xyz_m @ video.R.T + video.t
    depth = np.maximum(x[..., 2:], 0.05)
    focal = np.array([video.K[0, 0], video.K[1, 1]])
    pixels = x[..., :2] / depth * focal + video.K[:2, 2]
    rows = np.zeros((*x.shape[:2], 2, 3))
    rows[..., 0, 0], rows[..., 1, 1] = (focal / depth).transpose(2, 0, 1)
    rows[..., 2] = -(x[..., :2] / depth**2) * focal
    by_point = rows @ video.R
    by_offset = np.concatenate([by_point @ -_skew(xyz_m - centre), by_point], axis=-1)
    return ProjectedTemplate(pixels, by_offset)


def reprojection_squares(
    template: ProjectedTemplate, video: CalibratedVideo, moments: Int[np.ndarray, " T"]
) -> Callable[[slice, slice], Float[np.ndarray, "_t _s"]]:
    """Mean squared reprojection error of each frame at each moment, in units of the noise: a
    function of frames and moments.

    At every moment the best rigid offset of the body is fitted (variable projection): offsets that
    were fitted at a frame's current moment would absorb the error of that moment.

    Args:
        moments: current moment of each frame; there the outlier weights and the size of rigid
            offsets are estimated.
    """
    weight, precision = weights_and_precision(template, video, moments)
    count = np.maximum((weight / np.maximum(video.weight, 1e-12)).sum(1), 1e-6)
    middle = template.xy_px.mean(axis=(0, 1))
    detected = np.where(weight[..., None] > 0, video.xy_px - middle, 0.0)
    template_px = template.xy_px - middle

    def squares(frames: slice, positions: slice) -> np.ndarray:
        points, visible = detected[frames], weight[frames]
        total = squares_after_offsets(
            points, visible, template_px[positions], template.by_offset[positions], precision
        )
        return np.asarray(total / (2 * count[frames])[:, None])

    return squares


def weights_and_precision(
    template: ProjectedTemplate, video: CalibratedVideo, moments: Int[np.ndarray, " T"]
) -> tuple[Float[np.ndarray, "T K"], Float[np.ndarray, "6"]]:
    """Robust weights of the detections, and the inverse variances of rigid offsets, estimated at
    each frame's current moment (iteratively reweighted least squares)."""
    rows, residual = template.by_offset[moments], video.xy_px - template.xy_px[moments]
    residual = np.where(video.weight[..., None] > 0, residual, 0.0)
    spread, least = np.array(OFFSET_START), np.array(OFFSET_FLOOR)
    offsets, weight = np.zeros((len(moments), OFFSET)), video.weight
    for _ in range(ROUNDS):
        error = residual - np.einsum("tkac,tc->tka", rows, offsets)
        robust = geman_mcclure(video.weight * (error**2).sum(-1), OUTLIER_SIGMA)[1]
        weight = video.weight * robust
        hessian = np.einsum("tkac,tkad,tk->tcd", rows, rows, weight, optimize=True)
        hessian += np.diag(spread**-2.0)
        gradient = np.einsum("tkac,tka,tk->tc", rows, residual, weight, optimize=True)
        offsets = np.linalg.solve(hessian, gradient[..., None])[..., 0]
        spread = _spread(offsets, np.linalg.inv(hessian), least)
    return weight, spread**-2.0


def _spread(offsets: np.ndarray, covariance: np.ndarray, least: np.ndarray) -> np.ndarray:
    """(6,) standard deviations of rigid offsets, one for rotations and one for translations
    (expectation maximisation)."""
    square = (offsets**2 + np.diagonal(covariance, axis1=1, axis2=2)).mean(0)
    both = np.repeat([square[:3].mean(), square[3:].mean()], 3)
    return np.asarray(np.maximum(np.sqrt(both), least))


def _skew(x: np.ndarray) -> np.ndarray:
    """(..., 3, 3) cross product matrices."""
    zero = np.zeros_like(x[..., 0])
    a, b, c = x[..., 0], x[..., 1], x[..., 2]
    return np.stack([zero, -c, b, c, zero, -a, -b, a, zero], -1).reshape(*x.shape, 3)


@dataclass(frozen=True)
class ReprojectionEvidence:
    """All synchronised videos with their cameras, in their order."""

    videos: Sequence[CalibratedVideo]

    def template(
        self, v: int, soft_maps: Sequence[BandedMap], reference: int, per_frame: int
    ) -> ProjectedTemplate:
        """The others' motion (`leave_one_out_motion`) in video v's camera."""
        motion = leave_one_out_motion(self.videos, soft_maps, v, reference, per_frame)
        return projected(motion, self.videos[v])

    def squares(
        self,
        v: int,
        template: ProjectedTemplate,
        current: BandedMap,
        nearby: Sequence[Band],
        per_frame: int,
    ) -> NearbySquares | None:
        """Squared reprojection errors of video v against a template, each frame's in units of its
        smallest and of the typical smallest one.

        `current`: map (T_v, S) of v's frames, at whose moments outliers are told; `nearby`: the
        positions near its own. None where the typical error exceeds the noise: a performance that
        differs is mistaken for another moment, so that reprojection is less accurate than
        comparing poses.
        """
        positions = median_positions(current, per_frame) * per_frame
        moments = np.rint(positions).astype(np.int64)
        squares = NearbySquares.computed(
            current.shape, nearby, reprojection_squares(template, self.videos[v], moments)
        )
        typical = float(np.median(squares.least))
        if typical > LARGEST_SQUARE:
            return None
        return squares.divided(np.maximum(squares.least, typical))
