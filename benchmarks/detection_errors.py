"""Error statistics of a 2D keypoint detector: bias, spread, persistence, outliers, side swaps.

All lengths are shares of the person's standing height in the picture, so that they hold for people
of any size; a hundredth of it is 1.7 cm on a person of 1.7 m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.conventions import left_right_pairs, point_towards, sideless, swap_side

OUTLIER_SIGMA = 5.0  # errors beyond this many standard deviations (by the median) are outliers
RADIAL = 1.1774  # median distance of a two-dimensional Gaussian, in standard deviations an axis
LONGEST_S = 0.5  # longest lag of the correlation in time
LEAST_CORRELATION = 0.05
SWAPPED = 0.05  # of the height, a point, that a limb must be nearer to the other side
PARTS = {"arm": ("shoulder", "elbow", "wrist"), "leg": ("hip", "knee", "ankle")}


@dataclass(frozen=True)
class DetectedClip:
    """Detections in one clip whose true keypoints are given.

    Attributes:
        detected_px: NaN where missed.
        true_px: the truth.
        height_px: of the person as if standing upright in the picture.
        side: the side that the camera sees: front, side or back.
        fps: frames a second.
        is_used: detections with enough confidence to be used; None: all.
    """

    detected_px: Float[np.ndarray, "T K 2"]
    true_px: Float[np.ndarray, "T K 2"]
    height_px: Float[np.ndarray, " T"]
    side: str
    fps: float
    is_used: Bool[np.ndarray, "T K"] | None = None

    @property
    def error(self) -> Float[np.ndarray, "T K 2"]:
        """Detected minus true position, shares of the height."""
        return (self.detected_px - self.true_px) / self.height_px[:, None, None]


@dataclass(frozen=True)
class PointErrors:
    """Errors of one keypoint over several clips; lengths are shares of the height.

    Attributes:
        bias_x, bias_y: mean of the errors that are no outliers; y points down.
        spread: standard deviation an axis about each clip's bias.
        persistent, persistence_s: the correlation of errors over a time t is
            persistent exp(-t / persistence_s); NaN where errors are not correlated.
        outlier_rate, outlier_size: share of outliers and their root mean square an axis.
        unused_rate: share of detections that are not used.
        used_outlier_rate: share of outliers among the others, NaN where there are none.
        miss_rate: share of frames without a detection.
    """

    point: str
    bias_x: float
    bias_y: float
    spread: float
    persistent: float
    persistence_s: float
    outlier_rate: float
    outlier_size: float
    unused_rate: float
    used_outlier_rate: float
    miss_rate: float


def point_errors(clips: Sequence[DetectedClip], names: Sequence[str]) -> list[PointErrors]:
    """Error statistics of every keypoint over all clips."""
    return [_errors_of_point(clips, k, name) for k, name in enumerate(names)]


def swapped_share(clip: DetectedClip, names: Sequence[str], part: str) -> float:
    """Share of frames with a pair of limbs ("arm", "leg") swapped.

    Swapped: both limbs lie nearer to the other side's true position than to their own, by more
    than SWAPPED a point. NaN where no pair was ever detected.
    """
    pairs = [
        (a, b) for a, b in left_right_pairs(names) if names[a].removeprefix("left_") in PARTS[part]
    ]
    if not pairs:
        return float("nan")
    left, right = [a for a, _ in pairs], [b for _, b in pairs]
    to_same_side, to_other_side = (
        _distance(clip.detected_px, clip.true_px, left + right, to)
        for to in (left + right, right + left)
    )
    gain = (to_same_side - to_other_side) / clip.height_px[:, None]
    gain = gain[np.isfinite(gain).any(axis=1)]
    return float((np.nanmean(gain, axis=1) > SWAPPED).mean()) if len(gain) else float("nan")


def _distance(
    detected: np.ndarray, true: np.ndarray, points: list[int], to: list[int]
) -> np.ndarray:
    distance: np.ndarray = np.linalg.norm(detected[:, points] - true[:, to], axis=-1)
    return distance


def _errors_of_point(clips: Sequence[DetectedClip], k: int, name: str) -> PointErrors:
    errors = [clip.error[:, k] for clip in clips]
    every = np.concatenate(errors)
    detected = np.isfinite(every).all(axis=1)
    if not detected.any():
        nan = float("nan")
        return PointErrors(name, nan, nan, nan, nan, nan, nan, nan, nan, nan, 1.0)
    middle = np.median(every[detected], axis=0)
    away = np.linalg.norm(every[detected] - middle, axis=1)
    limit = OUTLIER_SIGMA * float(np.median(away)) / RADIAL
    inliers = [_without_outliers(error, middle, limit) for error in errors]
    centred = [u - np.nanmean(u, axis=0) for u in inliers if np.isfinite(u).any()]
    bias = np.nanmean(np.concatenate(inliers), axis=0)
    outliers = away > limit
    used = np.concatenate([_used(clip)[:, k] for clip in clips])[detected]
    persistent, persistence_s = correlation_in_time(centred, [clip.fps for clip in clips])
    return PointErrors(
        name,
        float(bias[0]),
        float(bias[1]),
        float(np.sqrt(np.nanmean(np.concatenate(centred) ** 2))),
        persistent,
        persistence_s,
        float(outliers.mean()),
        float(np.sqrt(np.mean(away[outliers] ** 2) / 2)) if outliers.any() else 0.0,
        float(1 - used.mean()),
        float(outliers[used].mean()) if used.any() else float("nan"),
        float(1 - detected.mean()),
    )


def _used(clip: DetectedClip) -> Bool[np.ndarray, "T K"]:
    if clip.is_used is None:
        return np.ones(clip.detected_px.shape[:2], dtype=bool)
    return clip.is_used


def _without_outliers(error: np.ndarray, middle: np.ndarray, limit: float) -> np.ndarray:
    """Errors (T, 2) with NaN for those further than the limit from the middle."""
    away = np.linalg.norm(error - middle, axis=1)
    return np.where((away <= limit)[:, None], error, np.nan)


def correlation_in_time(
    errors: Sequence[Float[np.ndarray, "_T 2"]], fps: Sequence[float]
) -> tuple[float, float]:
    """Exponential fitted to the autocorrelation of errors: (its value at lag 0, seconds).

    NaN where fewer than two lags are correlated.
    """
    times, correlations = [], []
    rate = float(np.median(fps))
    for lag in range(1, int(LONGEST_S * rate) + 1):
        pairs = [(e[:-lag], e[lag:]) for e in errors if len(e) > lag]
        products = np.concatenate([(a * b).ravel() for a, b in pairs] or [np.zeros(0)])
        power = np.concatenate([(0.5 * (a**2 + b**2)).ravel() for a, b in pairs] or [np.zeros(0)])
        both = np.isfinite(products)
        value = float(products[both].sum() / power[both].sum()) if both.any() else 0.0
        if value < LEAST_CORRELATION:
            break
        times.append(lag / rate)
        correlations.append(value)
    if len(times) < 2:
        return float("nan"), float("nan")
    slope, log_at_zero = np.polyfit(times, np.log(correlations), 1)
    return min(float(np.exp(log_at_zero)), 1.0), float(-1 / slope) if slope < 0 else float("nan")


# Systematic errors of a detector by kind of keypoint ("wrist" of both sides).
#
# Beside the statistics of detection_errors.py: the share of the way towards another keypoint by
# which a keypoint is displaced, the offset that stays the same for a whole clip, and the duration
# of outliers. They are the parameters of a simulated detector.

GAUSSIAN = 1.4826  # standard deviation over median distance from zero
FAR = 0.06  # of the height from the clip's usual offset: an outlier
ROUNDS = 3  # alternations of finding outliers and fitting the rest


@dataclass(frozen=True)
class DetectorBias:
    """Systematic errors of one kind of keypoint; lengths are shares of the standing height.

    Attributes:
        share: displacement towards the target, as a share of the way to it.
        lasting: standard deviation an axis (by the median), from clip to clip, of the offset that
            stays the same for a whole clip.
        spread: standard deviation an axis about that offset.
        persistent, persistence_s: as in PointErrors.
        outlier_rate, outlier_size: share of outliers, their root mean square an axis.
        outlier_s: mean duration of an outlier.
    """

    kind: str
    share: float
    lasting: float
    spread: float
    persistent: float
    persistence_s: float
    outlier_rate: float
    outlier_size: float
    outlier_s: float


def detector_bias(
    clips: Sequence[DetectedClip], names: Sequence[str], kind: str, target: str
) -> DetectorBias:
    """Measure one kind of keypoint, displaced towards a target (`conventions.point_towards`; ""
    for none)."""
    series = [
        _series(clip, names, side + kind, target) for clip in clips for side in _sides(names, kind)
    ]
    rates = [clip.fps for clip in clips for _ in _sides(names, kind)]
    share = 0.0
    inlier: list[np.ndarray] = [np.asarray(np.isfinite(error).all(axis=1)) for error, _ in series]
    for _ in range(ROUNDS):
        share = _share(series, inlier)
        rest = [error - share * way for error, way in series]
        middles = [np.nanmedian(r, axis=0) if np.isfinite(r).any() else np.zeros(2) for r in rest]
        away = [np.linalg.norm(r - m, axis=1) for r, m in zip(rest, middles, strict=True)]
        inlier = [np.less_equal(a, FAR) for a in away]
    usual = [np.where(k[:, None], r, np.nan) for r, k in zip(rest, inlier, strict=True)]
    usual = [u for u in usual if np.isfinite(u).any()]
    offsets = np.array([np.nanmean(u, axis=0) for u in usual])
    centred = [u - o for u, o in zip(usual, offsets, strict=True)]
    far: list[np.ndarray] = [np.greater(a, FAR) for a in away]
    every, outliers = np.concatenate(away), np.concatenate(far)
    persistent, persistence_s = correlation_in_time(centred, rates)
    return DetectorBias(
        kind,
        share,
        GAUSSIAN * float(np.median(np.abs(offsets))),
        float(np.sqrt(np.nanmean(np.concatenate(centred) ** 2))),
        persistent,
        persistence_s,
        float(outliers.sum() / np.isfinite(every).sum()),
        float(np.sqrt(np.mean(every[outliers] ** 2) / 2)) if outliers.any() else 0.0,
        _mean_duration_s(far, rates),
    )


def swapped_body_share(clip: DetectedClip, names: Sequence[str], nearer: float) -> float:
    """Share of frames with the whole body swapped: shoulders and hips all lie nearer to the
    other side's true position, by more than `nearer` of the height a point."""
    points = [k for k, n in enumerate(names) if sideless(n) in ("shoulder", "hip")]
    other_side = [list(names).index(swap_side(names[k])) for k in points]
    gain = [
        np.linalg.norm(clip.detected_px[:, points] - clip.true_px[:, to], axis=-1)
        / clip.height_px[:, None]
        for to in (points, other_side)
    ]
    least = (gain[0] - gain[1]).min(axis=1)
    valid = np.isfinite(least)
    return float((least[valid] > nearer).mean()) if valid.any() else float("nan")


def _sides(names: Sequence[str], kind: str) -> list[str]:
    return [side for side in ("left_", "right_", "") if side + kind in names]


def _series(
    clip: DetectedClip, names: Sequence[str], name: str, target: str
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (T, 2) of a keypoint, and its true displacement to the target (T, 2)."""
    point = list(names).index(name)
    if not target:
        return clip.error[:, point], np.zeros((len(clip.true_px), 2))
    to = list(names).index(point_towards(name, target))
    way = (clip.true_px[:, to] - clip.true_px[:, point]) / clip.height_px[:, None]
    return clip.error[:, point], way


def _share(series: Sequence[tuple[np.ndarray, np.ndarray]], inlier: Sequence[np.ndarray]) -> float:
    """Least squares over the inliers; 0 without a target."""
    error, way = (
        np.concatenate([s[i][k] for s, k in zip(series, inlier, strict=True)]) for i in (0, 1)
    )
    power = float((way**2).sum())
    return float((error * way).sum() / power) if power > 0 else 0.0


def _mean_duration_s(far: Sequence[np.ndarray], rates: Sequence[float]) -> float:
    """Mean duration of the runs of outliers."""
    lengths = [
        len(list(run)) / rate
        for one, rate in zip(far, rates, strict=True)
        for inside, run in groupby(one.tolist())
        if inside
    ]
    return float(np.mean(lengths)) if lengths else 0.0
