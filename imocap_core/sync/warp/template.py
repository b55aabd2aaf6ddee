"""Template: the mean of the videos' poses; positions of frames in it, and squared distances.

A monocular estimate is certain across its line of sight and uncertain along it, and videos look
from different sides: the mean weighs every direction of every video's poses by its precision, as
triangulation does. Distances of a video's frames are computed to all positions, a few frames at a
time, since the best of all judges how well a frame fits; those near its soft map are stored.

Squared distances of frames' points x from a template's p after the best small rigid offset o of
each pair (variable projection), B its derivatives, w the weights, P offsets' inverse variances:

    min_o sum_k w_k |x_k - p_k - B_k o|^2 + o' P o = sum_k w_k |x_k - p_k|^2 - g' H^-1 g,
    g = sum_k w_k B_k' (x_k - p_k),   H = sum_k w_k B_k' B_k + P.

All terms are linear in w and w x, so a block of frames and templates takes a few matrix products;
blocks are so small that their terms stay in the processor's cache.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.optimize import isotonic_regression

from imocap_core.sync.maps import Band, BandedMap, whole_band
from imocap_core.sync.procrustes import centred, rotations_onto

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
    """precision^-1 pull (..., 3), by cofactors of the symmetric matrices; 0 where these are 0."""
    unit = float(np.trace(precision, axis1=-2, axis2=-1).mean()) / 3 or 1.0
    planes = np.moveaxis(precision, (-2, -1), (0, 1)) / unit
    planes[[0, 1, 2], [0, 1, 2]] += LEAST_PRECISION
    (a, b, c), (_, d, e), (_, _, f) = planes
    x, y, z = np.moveaxis(pull, -1, 0) / unit
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
    solved = np.stack([A * x + B * y + C * z, B * x + D * y + E * z, C * x + E * y + F * z], -1)
    solved /= (a * A + b * B + c * C)[..., None]
    return solved


def median_positions(
    soft_map: Float[np.ndarray, "N S"] | BandedMap, per_frame: int = 1
) -> Float[np.ndarray, " N"]:
    """The median of each row of a stochastic map, in frames, fractional: it minimises the mean
    error.

    Each column is taken as a bin one column wide; `per_frame` columns make a frame.
    """
    banded = _as_banded(soft_map)
    position = np.zeros(banded.shape[0])
    for rows, columns, values in banded:
        position[rows] = columns.start + _medians(values)
    return np.asarray(np.clip(position, 0.0, banded.shape[1] - 1.0) / per_frame)


def _medians(soft_map: np.ndarray) -> np.ndarray:
    """Median column (N,) of each row."""
    cumulative = np.cumsum(soft_map, axis=1, dtype=float)
    cumulative /= np.maximum(soft_map.sum(axis=1, keepdims=True, dtype=float), 1e-300)
    bin_ = (cumulative >= 0.5).argmax(axis=1)[:, None]
    upper = np.take_along_axis(cumulative, bin_, 1)
    lower = np.where(bin_ > 0, np.take_along_axis(cumulative, np.maximum(bin_ - 1, 0), 1), 0.0)
    inside = (0.5 - lower) / np.maximum(upper - lower, 1e-12)
    return np.asarray(bin_[:, 0] - 0.5 + inside[:, 0])


def isotonic(
    positions: Float[np.ndarray, " N"], weights: Float[np.ndarray, " N"]
) -> Float[np.ndarray, " N"]:
    """The nearest non-decreasing warp (weighted least squares); NaN stay NaN and separate
    nothing."""
    out = positions.copy()
    matched = np.isfinite(positions)
    if matched.any():
        out[matched] = isotonic_regression(positions[matched], weights=weights[matched] + 1e-6).x
    return out


def mass_within(
    soft_map: Float[np.ndarray, "N S"] | BandedMap,
    positions: Float[np.ndarray, " N"],
    reach: float,
    per_frame: int = 1,
) -> Float[np.ndarray, " N"]:
    """P(the true position is within `reach` frames of `positions`), per row of a stochastic map."""
    banded = _as_banded(soft_map)
    mass, half = np.zeros(banded.shape[0]), 0.5 / per_frame  # each column is a bin
    for rows, columns, values in banded:
        bins = np.arange(columns.start, columns.stop) / per_frame
        low = np.maximum(bins - half, (positions[rows] - reach)[:, None])
        high = np.minimum(bins + half, (positions[rows] + reach)[:, None])
        # the part of the bin that lies within reach
        mass[rows] = (values * np.maximum(high - low, 0.0) * per_frame).sum(axis=1)
    return mass


def _as_banded(soft_map: np.ndarray | BandedMap) -> BandedMap:
    return soft_map if isinstance(soft_map, BandedMap) else whole_band(soft_map)


ENTRIES_AT_ONCE = 1 << 20
# with more pairs of frame and position than that the best of all is that of every n-th position
ALL_COMPARED = 1 << 24


@dataclass(frozen=True)
class NearbySquares:
    """Squared distances in a band that every frame has; NaN unknown.

    Attributes:
        least: each frame's smallest one, over all positions; NaN where none is known.
    """

    nearby: BandedMap
    least: Float[np.ndarray, " N"]

    @classmethod
    def of(cls, squares: Float[np.ndarray, "N S"]) -> NearbySquares:
        """All positions."""
        return cls(whole_band(squares), least_of_rows(squares))

    @classmethod
    def computed(
        cls,
        shape: tuple[int, int],
        bands: Sequence[Band],
        squares: Callable[[slice, slice], Float[np.ndarray, "_n _s"]],
    ) -> NearbySquares:
        """From a function of frames and positions."""
        (N, S), least, values = shape, np.empty(shape[0]), []
        every = -(-N * S // ALL_COMPARED)
        rows_at_once = max(1, ENTRIES_AT_ONCE // max(1, S // every))
        for group in _grouped(bands, rows_at_once):
            rows = slice(group[0][0].start, group[-1][0].stop)
            far = squares(rows, slice(0, S, every))
            least[rows] = least_of_rows(far)
            for frames, positions in group:
                part = slice(frames.start - rows.start, frames.stop - rows.start)
                if every == 1:
                    values.append(far[part, positions].copy())
                else:
                    values.append(squares(frames, positions))
                    least[frames] = np.fmin(least[frames], least_of_rows(values[-1]))
        return cls(BandedMap(shape, bands, values), least)

    def plus(self, further: Callable[[slice, slice], Float[np.ndarray, "_n _s"]]) -> NearbySquares:
        """With further squared distances; each frame's smallest one is of the nearby positions."""
        both = self.nearby.mapped(lambda rows, columns, x: x + further(rows, columns))
        least = np.full(len(self.least), np.nan)
        for rows, _, values in both:
            least[rows] = least_of_rows(values)
        return NearbySquares(both, least)

    def divided(self, by: Float[np.ndarray, " N"]) -> NearbySquares:
        """Every frame's in units of its number."""
        return replace(self, nearby=self.nearby.scaled(1.0 / by), least=self.least / by)


def least_of_rows(squares: Float[np.ndarray, "N S"]) -> Float[np.ndarray, " N"]:
    """The smallest known one of each row; NaN where none is."""
    least = np.fmin.reduce(squares, axis=1)
    return np.asarray(least)


def _grouped(bands: Sequence[Band], rows: int) -> list[list[Band]]:
    """Successive bands, of so many frames together or of one band."""
    groups: list[list[Band]] = []
    for band in bands:
        if groups and band[0].stop - groups[-1][0][0].start <= rows:
            groups[-1].append(band)
        else:
            groups.append([band])
    return groups


FRAMES, TEMPLATES = 32, 256  # of a block
OFFSET = 6  # parameters of a rigid offset: rotation vector, translation
# their standard deviations, rad and m: where an estimation starts, and the least that it returns
OFFSET_START, OFFSET_FLOOR = (0.08,) * 3 + (0.15,) * 3, (0.01,) * 3 + (0.005,) * 3
LOWER = [(i, j) for i in range(OFFSET) for j in range(i + 1)]
DIAGONAL = [n for n, (i, j) in enumerate(LOWER) if i == j]


def squares_after_offsets(
    points: Float[np.ndarray, "T K 2"],
    weight: Float[np.ndarray, "T K"],
    templates: Float[np.ndarray, "S K 2"],
    by_offset: Float[np.ndarray, "S K 2 6"],
    precision: Float[np.ndarray, "6"],
) -> Float[np.ndarray, "T S"]:
    """The minimum for every frame and template; points of weight 0 may be anything finite."""
    squares = np.empty((len(points), len(templates)))
    weighted = (weight[..., None] * points).reshape(len(points), -1)
    constant = (weight * (points**2).sum(-1)).sum(1)
    for columns in _blocks(len(templates), TEMPLATES):
        terms = _TemplateTerms.of(templates[columns], by_offset[columns])
        for rows in _blocks(len(points), FRAMES):
            squares[rows, columns] = _block_squares(
                weight[rows], weighted[rows], constant[rows], terms, precision
            )
    return squares


@dataclass(frozen=True)
class _TemplateTerms:
    """What w or w x of S templates is multiplied with, as matrices of contiguous rows; their
    columns are (parameter, template)."""

    p: Float[np.ndarray, "KX S"]
    pp: Float[np.ndarray, "K S"]
    B: Float[np.ndarray, "KX OS"]
    Bp: Float[np.ndarray, "K OS"]
    BB: Float[np.ndarray, "K LS"]  # lower triangles of B' B

    @classmethod
    def of(
        cls, templates: Float[np.ndarray, "S K 2"], by_offset: Float[np.ndarray, "S K 2 6"]
    ) -> _TemplateTerms:
        K = templates.shape[1]
        p = np.ascontiguousarray(templates.transpose(1, 2, 0))
        B = np.ascontiguousarray(by_offset.transpose(1, 2, 3, 0))
        Bp = np.einsum("kacs,kas->kcs", B, p)
        BB = np.stack([(B[:, :, i] * B[:, :, j]).sum(1) for i, j in LOWER], axis=1)
        return cls(
            p=p.reshape(2 * K, -1),
            pp=(p**2).sum(1),
            B=B.reshape(2 * K, -1),
            Bp=Bp.reshape(K, -1),
            BB=BB.reshape(K, -1),
        )


def _block_squares(
    weight: np.ndarray,
    weighted: np.ndarray,
    constant: np.ndarray,
    terms: _TemplateTerms,
    precision: np.ndarray,
) -> np.ndarray:
    """`squares_after_offsets` of one block."""
    T, S = len(weight), terms.p.shape[1]
    error = constant[:, None] - 2 * weighted @ terms.p + weight @ terms.pp
    gradient = (weighted @ terms.B - weight @ terms.Bp).reshape(T, OFFSET, S)
    hessian = (weight @ terms.BB).reshape(T, len(LOWER), S)
    hessian[:, DIAGONAL] += precision[:, None]
    return np.maximum(error - _quadratic(hessian, gradient), 0.0)


def _quadratic(lower: np.ndarray, g: np.ndarray) -> np.ndarray:
    """(T, S) g' H^-1 g for H given by its lower triangle (T, 21, S), row by row, and g (T, 6, S).

    Cholesky and forward substitution, every step for all T x S systems at once.
    """
    L = {pair: lower[:, n] for n, pair in enumerate(LOWER)}
    y: list[np.ndarray] = []
    for i in range(OFFSET):
        for j in range(i + 1):
            value = L[i, j] - sum(L[i, k] * L[j, k] for k in range(j))
            L[i, j] = np.sqrt(value) if i == j else value / L[j, j]
        y.append((g[:, i] - sum(L[i, k] * y[k] for k in range(i))) / L[i, i])
    total: np.ndarray = sum(part**2 for part in y[1:]) + y[0] ** 2
    return total


def _blocks(length: int, size: int) -> Iterator[slice]:
    return (slice(first, first + size) for first in range(0, length, size))
