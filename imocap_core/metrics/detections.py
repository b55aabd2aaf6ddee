"""How a detector errs, against where the points truly are: bias, spread, persistence, exchanges.

All lengths are shares of the person's standing height in the picture, so that they hold for people
of any size; a hundredth of it is 1.7 cm on a person of 1.7 m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.conventions import left_right_pairs

Array = NDArray[np.float64]

OUTLIER_SIGMA = 5.0  # beyond so many spreads (by the median) an error is an outlier
RADIAL = 1.1774  # median distance of a two-dimensional Gaussian, in standard deviations an axis
LONGEST_S = 0.5  # over which the correlation in time is looked at
LEAST_CORRELATION = 0.05
EXCHANGED = 0.05  # of the height, a point, that a limb must be nearer to the other side
PARTS = {"arm": ("shoulder", "elbow", "wrist"), "leg": ("hip", "knee", "ankle")}


@dataclass(frozen=True)
class Film:
    """What a detector said of a film whose truth is known.

    found_px, true_px: (T, K, 2), found NaN where missed; height_px (T,) of the person as if
    standing upright in the picture; side: what the camera sees (front, side, back); fps.
    """

    found_px: Array
    true_px: Array
    height_px: Array
    side: str
    fps: float

    @property
    def error(self) -> Array:
        """(T, K, 2) shares of the height."""
        return (self.found_px - self.true_px) / self.height_px[:, None, None]


@dataclass(frozen=True)
class PointErrors:
    """One point's errors over some films.

    bias: mean (x, y, y down) of what is no outlier; spread: standard deviation an axis about the
    film's own bias; persistent, persistence_s: the errors' correlation over a time t is persistent
    exp(-t / persistence_s), NaN where there is none; outlier_rate, outlier_size: share and root
    mean square an axis of larger errors; miss_rate.
    """

    point: str
    bias_x: float
    bias_y: float
    spread: float
    persistent: float
    persistence_s: float
    outlier_rate: float
    outlier_size: float
    miss_rate: float


def point_errors(films: Sequence[Film], names: Sequence[str]) -> list[PointErrors]:
    """A row for every point, over all films."""
    return [_of_point(films, k, name) for k, name in enumerate(names)]


def exchanged_share(film: Film, names: Sequence[str], part: str) -> float:
    """Share of frames in which a pair of limbs ("arm", "leg") is found exchanged: both lie nearer
    to the other side's true place than to their own, by more than EXCHANGED a point. NaN where no
    pair was ever found."""
    pairs = [
        (a, b) for a, b in left_right_pairs(names) if names[a].removeprefix("left_") in PARTS[part]
    ]
    if not pairs:
        return float("nan")
    left, right = [a for a, _ in pairs], [b for _, b in pairs]
    own, other = (
        _distance(film.found_px, film.true_px, left + right, to)
        for to in (left + right, right + left)
    )
    gain = (own - other) / film.height_px[:, None]
    gain = gain[np.isfinite(gain).any(axis=1)]
    return float((np.nanmean(gain, axis=1) > EXCHANGED).mean()) if len(gain) else float("nan")


def _distance(found: Array, true: Array, of: list[int], to: list[int]) -> Array:
    distance: Array = np.linalg.norm(found[:, of] - true[:, to], axis=-1)
    return distance


def _of_point(films: Sequence[Film], k: int, name: str) -> PointErrors:
    errors = [film.error[:, k] for film in films]
    every = np.concatenate(errors)
    known = np.isfinite(every).all(axis=1)
    if not known.any():
        nan = float("nan")
        return PointErrors(name, nan, nan, nan, nan, nan, nan, nan, 1.0)
    middle = np.median(every[known], axis=0)
    away = np.linalg.norm(every[known] - middle, axis=1)
    limit = OUTLIER_SIGMA * float(np.median(away)) / RADIAL
    usual = [_without(error, middle, limit) for error in errors]
    centred = [u - np.nanmean(u, axis=0) for u in usual if np.isfinite(u).any()]
    bias = np.nanmean(np.concatenate(usual), axis=0)
    outliers = away > limit
    persistent, persistence_s = correlation_in_time(centred, [film.fps for film in films])
    return PointErrors(
        name,
        float(bias[0]),
        float(bias[1]),
        float(np.sqrt(np.nanmean(np.concatenate(centred) ** 2))),
        persistent,
        persistence_s,
        float(outliers.mean()),
        float(np.sqrt(np.mean(away[outliers] ** 2) / 2)) if outliers.any() else 0.0,
        float(1 - known.mean()),
    )


def _without(error: Array, middle: Array, limit: float) -> Array:
    """Errors (T, 2) with NaN for those further than the limit from the middle."""
    away = np.linalg.norm(error - middle, axis=1)
    return np.where((away <= limit)[:, None], error, np.nan)


def correlation_in_time(errors: Sequence[Array], fps: Sequence[float]) -> tuple[float, float]:
    """(share, seconds) of the exponential that the correlation in time follows."""
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
    slope, at_zero = np.polyfit(times, np.log(correlations), 1)
    return min(float(np.exp(at_zero)), 1.0), float(-1 / slope) if slope < 0 else float("nan")
