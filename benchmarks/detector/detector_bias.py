"""Systematic errors of a detector by kind of keypoint ("wrist" of both sides).

Beside the statistics of detection_errors.py: the share of the way towards another keypoint by
which a keypoint is displaced, the offset that stays the same for a whole clip, and the
duration of outliers. They are the parameters of a simulated detector.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from benchmarks.detector.detection_errors import DetectedClip, correlation_in_time
from imocap_core.conventions import point_towards, sideless, swap_side

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
