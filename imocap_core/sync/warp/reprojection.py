"""Synchronisation by what the pictures show of the common motion, once cameras are known.

Poses found together agree with the correspondences they were found with, so comparing them again
confirms those. Detections do not: here every frame's keypoints are held against the projections of
the other videos' motion at every moment, and the moment that fits best is its counterpart.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.params import MotionParams
from imocap_core.robust import geman_mcclure
from imocap_core.sync.warp.positions import median_positions
from imocap_core.sync.warp.template import Contribution, alike, positions_between, template

Array = NDArray[np.float64]

ROUNDS = 4
OUTLIER_SIGMA = 4.0  # scale of the Geman-McClure weights
MOST_NOISE = 2.25  # mean square left, of the detector's variance: one half as bad again as assumed
CHUNK = 16
STRAYS = 6
LOWER = [(i, j) for i in range(STRAYS) for j in range(i + 1)]
DIAGONAL = [n for n, (i, j) in enumerate(LOWER) if i == j]


@dataclass(frozen=True)
class CalibratedVideo:
    """One video.

    Attributes:
        xyz_m: (T, K, 3) its performer's keypoints in the common world, as found so far.
        xy_px: (T, K, 2) detections, any value where unseen; weight: (T, K) 1/px^2, 0 unseen.
        K: (3, 3); R: (3, 3), t: (3,) camera from the common world.
    """

    xyz_m: Array
    xy_px: Array
    weight: Array
    K: Array
    R: Array
    t: Array


@dataclass(frozen=True)
class Projected:
    """A template of S moments in one camera: pixels (S, K, 2), and their derivatives (S, K, 2, 6)
    by a turn about the body's middle and a shift."""

    xy_px: Array
    by_stray: Array


def others_motion(
    videos: Sequence[CalibratedVideo],
    maps: Sequence[Array],
    without: int,
    reference: int,
    per_frame: int,
) -> Array:
    """(S, K, 3) the motion at the positions of the reference by all videos but one.

    Args:
        maps: (T_v, S) soft maps into the reference's positions.
    """
    parts: list[Contribution] = []
    for u, (video, soft) in enumerate(zip(videos, maps, strict=True)):
        if u == without:
            continue
        seen = np.ones(video.xyz_m.shape[:2])
        if u == reference:
            parts.append(alike(*positions_between(video.xyz_m, seen, per_frame)))
            continue
        total = (soft.T @ seen)[..., None]
        mixed = (soft.T @ video.xyz_m.reshape(len(soft), -1)).reshape(-1, *video.xyz_m.shape[1:])
        parts.append(alike(mixed / np.maximum(total, 1e-9), np.minimum(total[..., 0], 1.0)))
    return template(parts).poses


def projected(xyz_m: Array, video: CalibratedVideo) -> Projected:
    """A motion (S, K, 3) as a video's camera sees it."""
    middle = xyz_m.mean(axis=1, keepdims=True)
    x = xyz_m @ video.R.T + video.t
    depth = np.maximum(x[..., 2:], 0.05)
    focal = np.array([video.K[0, 0], video.K[1, 1]])
    pixels = x[..., :2] / depth * focal + video.K[:2, 2]
    rows = np.zeros((*x.shape[:2], 2, 3))
    rows[..., 0, 0], rows[..., 1, 1] = (focal / depth).transpose(2, 0, 1)
    rows[..., 2] = -(x[..., :2] / depth**2) * focal
    by_point = rows @ video.R
    return Projected(pixels, np.concatenate([by_point @ -_skew(xyz_m - middle), by_point], axis=-1))


def squares_in_picture(
    seen: Projected, video: CalibratedVideo, at: NDArray[np.int64], motion: MotionParams
) -> Array:
    """(T, S) mean squared distance of each frame's detections to each moment, in units of noise.

    At every moment the performance may turn and shift as a whole, and what fits best there counts
    (variable projection): strays found where a frame lies so far would take up the time it is off.
    How large strays are, and which detections are outliers, is told at those moments ``at`` (T,).
    """
    weight, precision = weights_and_precision(seen, video, at, motion)
    count = np.maximum((weight / np.maximum(video.weight, 1e-12)).sum(1), 1e-6)
    moments, points = seen.xy_px.shape[:2]
    middle = seen.xy_px.mean(axis=(0, 1))
    place = (seen.xy_px - middle).transpose(1, 2, 0)  # (K, 2, S)
    found = np.where(weight[..., None] > 0, video.xy_px - middle, 0.0)
    rows = seen.by_stray.transpose(1, 2, 3, 0)  # (K, 2, 6, S)
    pairs = np.stack([(rows[:, :, i] * rows[:, :, j]).sum(1) for i, j in LOWER], axis=1)
    against = np.einsum("kacs,kas->kcs", rows, place)
    squares = np.empty((len(at), moments))
    for first in range(0, len(at), CHUNK):
        own = slice(first, first + CHUNK)
        w, x = weight[own], weight[own, :, None] * found[own]
        flat = x.reshape(len(w), -1)
        alone = (x * found[own]).sum((1, 2))[:, None]
        apart = alone - 2 * flat @ place.reshape(-1, moments) + w @ (place**2).sum(1)
        pull = flat @ rows.reshape(2 * points, -1) - w @ against.reshape(points, -1)
        sharpness = (w @ pairs.reshape(points, -1)).reshape(len(w), -1, moments)
        sharpness[:, DIAGONAL] += precision[:, None]
        explained = _quadratic(sharpness, pull.reshape(len(w), -1, moments))
        squares[own] = np.maximum(apart - explained, 0.0)
    return squares / (2 * count)[:, None]


def _quadratic(lower: Array, g: Array) -> Array:
    """(T, S) g' H^-1 g for H given by its lower triangle (T, 21, S), row by row, and g (T, 6, S).

    Cholesky and forward substitution, every step for all T x S systems at once.
    """
    L = {pair: lower[:, n] for n, pair in enumerate(LOWER)}
    y: list[Array] = []
    for i in range(STRAYS):
        for j in range(i + 1):
            value = L[i, j] - sum(L[i, k] * L[j, k] for k in range(j))
            L[i, j] = np.sqrt(value) if i == j else value / L[j, j]
        y.append((g[:, i] - sum(L[i, k] * y[k] for k in range(i))) / L[i, i])
    total: Array = sum(part**2 for part in y[1:]) + y[0] ** 2
    return total


def weights_and_precision(
    seen: Projected, video: CalibratedVideo, at: NDArray[np.int64], motion: MotionParams
) -> tuple[Array, Array]:
    """The robust weights (T, K) of the detections and the inverse variances (6,) of strays, told
    where each frame lies."""
    rows, residual = seen.by_stray[at], video.xy_px - seen.xy_px[at]
    residual = np.where(video.weight[..., None] > 0, residual, 0.0)
    spread = _turn_and_shift(motion.rigid_offset_start_rad, motion.rigid_offset_start_m)
    least = _turn_and_shift(motion.rigid_offset_floor_rad, motion.rigid_offset_floor_m)
    strays, weight = np.zeros((len(at), STRAYS)), video.weight
    for _ in range(ROUNDS):
        left = residual - np.einsum("tkac,tc->tka", rows, strays)
        robust = geman_mcclure(video.weight * (left**2).sum(-1), OUTLIER_SIGMA)[1]
        weight = video.weight * robust
        sharpness = np.einsum("tkac,tkad,tk->tcd", rows, rows, weight, optimize=True)
        sharpness += np.diag(spread**-2.0)
        pull = np.einsum("tkac,tka,tk->tc", rows, residual, weight, optimize=True)
        strays = np.linalg.solve(sharpness, pull[..., None])[..., 0]
        spread = _spread(strays, np.linalg.inv(sharpness), least)
    return weight, spread**-2.0


def _turn_and_shift(turn_rad: float, shift_m: float) -> Array:
    """(6,) three turns and three shifts."""
    return np.array([turn_rad] * 3 + [shift_m] * 3)


def _spread(strays: Array, covariance: Array, least: Array) -> Array:
    """(6,) one spread of the turns and one of the shifts (expectation maximisation)."""
    square = (strays**2 + np.diagonal(covariance, axis1=1, axis2=2)).mean(0)
    both = np.repeat([square[:3].mean(), square[3:].mean()], 3)
    return np.asarray(np.maximum(np.sqrt(both), least))


def _skew(x: Array) -> Array:
    """(..., 3, 3) cross product matrices."""
    zero = np.zeros_like(x[..., 0])
    a, b, c = x[..., 0], x[..., 1], x[..., 2]
    return np.stack([zero, -c, b, c, zero, -a, -b, a, zero], -1).reshape(*x.shape, 3)


@dataclass(frozen=True)
class ReprojectionEvidence:
    """The pictures of all videos that are synchronised, in their order.

    Attributes:
        params: of them the spreads of rigid offsets.
    """

    videos: Sequence[CalibratedVideo]
    params: MotionParams

    def squares(
        self, v: int, maps: Sequence[Array], reference: int, per_frame: int
    ) -> Array | None:
        """(T_v, S) squared distances of video v's frames to the others' motion, each frame's
        in units of its best fit and of the typical one (`maps` as of `others_motion`).

        None where more than noise lies between: a performance that differs is taken for another
        moment, so that its pictures tell time worse than its poses.
        """
        motion = others_motion(self.videos, maps, v, reference, per_frame)
        at = np.rint(median_positions(maps[v], per_frame) * per_frame).astype(np.int64)
        seen = projected(motion, self.videos[v])
        squares = squares_in_picture(seen, self.videos[v], at, self.params)
        best = squares.min(axis=1, keepdims=True)
        typical = float(np.median(best))
        return squares / np.maximum(best, typical) if typical <= MOST_NOISE else None
