"""Error statistics of a 2D keypoint detector: bias, spread, persistence, outliers, side swaps.

All lengths are shares of the person's standing height in the picture, so that they hold for people
of any size; a hundredth of it is 1.7 cm on a person of 1.7 m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.conventions import left_right_pairs

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
