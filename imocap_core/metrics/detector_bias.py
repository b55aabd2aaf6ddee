"""A detector's habits, kind of point by kind ("wrist" of both sides): what a simulated one needs.

Beside the errors of imocap_core/metrics/detections.py: how far towards another point a point is
marked, what offset it keeps for a whole film, how long outliers stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from imocap_core.conventions import point_towards, sideless, swap_side
from imocap_core.metrics.detections import Array, Film, correlation_in_time

Mask = NDArray[np.bool_]

GAUSSIAN = 1.4826  # standard deviation over median distance from zero
FAR = 0.06  # of the height from the film's usual offset: an outlier
ROUNDS = 3  # of finding outliers and fitting the rest


@dataclass(frozen=True)
class Habit:
    """Of one kind of point; lengths are shares of the standing height.

    share: of the way to the target; lasting: standard deviation an axis (by the median), from film
    to film, of the offset that stays; spread: about that offset; persistent, persistence_s: as in
    PointErrors; outlier_rate, outlier_size (root mean square an axis), outlier_s: how long one
    stays, mean.
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


def habit_of(films: Sequence[Film], names: Sequence[str], kind: str, target: str) -> Habit:
    """Measure a kind that is marked towards a target (`conventions.point_towards`; "" for none)."""
    series = [
        _series(film, names, side + kind, target) for film in films for side in _sides(names, kind)
    ]
    rates = [film.fps for film in films for _ in _sides(names, kind)]
    share = 0.0
    kept: list[Mask] = [np.asarray(np.isfinite(error).all(axis=1)) for error, _ in series]
    for _ in range(ROUNDS):
        share = _share(series, kept)
        rest = [error - share * way for error, way in series]
        middles = [np.nanmedian(r, axis=0) if np.isfinite(r).any() else np.zeros(2) for r in rest]
        away = [np.linalg.norm(r - m, axis=1) for r, m in zip(rest, middles, strict=True)]
        kept = [np.less_equal(a, FAR) for a in away]
    usual = [np.where(k[:, None], r, np.nan) for r, k in zip(rest, kept, strict=True)]
    held = [u for u in usual if np.isfinite(u).any()]
    offsets = np.array([np.nanmean(u, axis=0) for u in held])
    centred = [u - o for u, o in zip(held, offsets, strict=True)]
    far: list[Mask] = [np.greater(a, FAR) for a in away]
    every, outliers = np.concatenate(away), np.concatenate(far)
    persistent, persistence_s = correlation_in_time(centred, rates)
    return Habit(
        kind,
        share,
        GAUSSIAN * float(np.median(np.abs(offsets))),
        float(np.sqrt(np.nanmean(np.concatenate(centred) ** 2))),
        persistent,
        persistence_s,
        float(outliers.sum() / np.isfinite(every).sum()),
        float(np.sqrt(np.mean(every[outliers] ** 2) / 2)) if outliers.any() else 0.0,
        _bouts_s(far, rates),
    )


def turned_share(film: Film, names: Sequence[str], nearer: float) -> float:
    """Share of frames in which the whole body is found exchanged: shoulders and hips all lie nearer
    to the other side's true place, by more than `nearer` a point."""
    own = [k for k, n in enumerate(names) if sideless(n) in ("shoulder", "hip")]
    other = [list(names).index(swap_side(names[k])) for k in own]
    gain = [
        np.linalg.norm(film.found_px[:, own] - film.true_px[:, to], axis=-1)
        / film.height_px[:, None]
        for to in (own, other)
    ]
    least = (gain[0] - gain[1]).min(axis=1)
    known = np.isfinite(least)
    return float((least[known] > nearer).mean()) if known.any() else float("nan")


def _sides(names: Sequence[str], kind: str) -> list[str]:
    return [side for side in ("left_", "right_", "") if side + kind in names]


def _series(film: Film, names: Sequence[str], name: str, target: str) -> tuple[Array, Array]:
    """Errors (T, 2) of a point and its true way to the target (T, 2)."""
    at = list(names).index(name)
    if not target:
        return film.error[:, at], np.zeros((len(film.true_px), 2))
    to = list(names).index(point_towards(name, target))
    way = (film.true_px[:, to] - film.true_px[:, at]) / film.height_px[:, None]
    return film.error[:, at], way


def _share(series: Sequence[tuple[Array, Array]], kept: Sequence[Mask]) -> float:
    """Least squares over what is kept; 0 without a target."""
    error, way = (
        np.concatenate([s[i][k] for s, k in zip(series, kept, strict=True)]) for i in (0, 1)
    )
    power = float((way**2).sum())
    return float((error * way).sum() / power) if power > 0 else 0.0


def _bouts_s(far: Sequence[Mask], rates: Sequence[float]) -> float:
    """Mean time an outlier stays."""
    lengths = [
        len(list(run)) / rate
        for one, rate in zip(far, rates, strict=True)
        for inside, run in groupby(one.tolist())
        if inside
    ]
    return float(np.mean(lengths)) if lengths else 0.0
