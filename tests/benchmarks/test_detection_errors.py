"""The statistics of a detector's errors give back the errors that were put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.detector.detection_errors import DetectedClip, point_errors, swapped_share
from imocap_core.synthetic.detector import persistent_noise

NAMES = ("nose", "left_shoulder", "left_elbow", "left_wrist", "right_shoulder", "right_elbow",
         "right_wrist")  # fmt: skip
HEIGHT_PX, FPS = 400.0, 30.0
BIAS, SPREAD = np.array([0.01, -0.02]), 0.008


def film(rng: np.random.Generator, frames: int = 3000) -> DetectedClip:
    true = 300 + 150 * rng.uniform(-1, 1, (1, len(NAMES), 2)) + 20 * rng.normal(size=(frames, 1, 2))
    error = BIAS + SPREAD * persistent_noise(true.shape, 0.3 * FPS, rng)
    return DetectedClip(true + HEIGHT_PX * error, true, np.full(frames, HEIGHT_PX), "front", FPS)


def test_bias_spread_and_persistence_come_back() -> None:
    rng = np.random.default_rng(0)
    for row in point_errors([film(rng), film(rng)], NAMES):
        assert (row.bias_x, row.bias_y) == pytest.approx(tuple(BIAS), abs=0.0015)
        assert row.spread == pytest.approx(SPREAD, rel=0.1)
        assert row.persistent == pytest.approx(0.5, abs=0.1)
        assert row.persistence_s == pytest.approx(0.3, abs=0.12)
        assert row.outlier_rate < 0.001
        assert row.miss_rate == 0


def test_errors_scale_with_the_person() -> None:
    small = film(np.random.default_rng(1))
    large = DetectedClip(
        3 * small.detected_px, 3 * small.true_px, 3 * small.height_px, "front", FPS
    )
    for a, b in zip(point_errors([small], NAMES), point_errors([large], NAMES), strict=True):
        assert a.spread == pytest.approx(b.spread)
        assert a.bias_x == pytest.approx(b.bias_x)


def test_outliers_and_misses_are_counted_apart() -> None:
    rng = np.random.default_rng(2)
    clean = film(rng)
    detected = clean.detected_px.copy()
    wrong = rng.random(len(detected)) < 0.04
    detected[wrong, 0] += 0.2 * HEIGHT_PX
    detected[rng.random(len(detected)) < 0.1, 1] = np.nan
    spoiled = DetectedClip(detected, clean.true_px, clean.height_px, "front", FPS)
    nose, shoulder = point_errors([spoiled], NAMES)[:2]
    assert nose.outlier_rate == pytest.approx(wrong.mean(), abs=0.003)
    assert nose.outlier_size == pytest.approx(0.2, rel=0.1)
    assert (nose.unused_rate, nose.used_outlier_rate) == (0.0, nose.outlier_rate)
    is_used = np.tile(~wrong[:, None], len(NAMES))
    is_used[np.flatnonzero(wrong)[0]] = True  # one of the wrong ones is used all the same
    (unsure, *_) = point_errors([replace(spoiled, is_used=is_used)], NAMES)
    assert unsure.outlier_rate == nose.outlier_rate
    assert unsure.unused_rate == pytest.approx((wrong.sum() - 1) / len(wrong))
    assert unsure.used_outlier_rate == pytest.approx(1 / is_used[:, 0].sum(), abs=0.002)
    assert nose.spread == pytest.approx(SPREAD, rel=0.1)
    assert nose.bias_x == pytest.approx(BIAS[0], abs=0.0015)
    assert shoulder.miss_rate == pytest.approx(0.1, abs=0.02)
    assert shoulder.outlier_rate < 0.001


def test_swapped_arms_and_only_those_are_counted() -> None:
    clean = film(np.random.default_rng(3), frames=200)
    assert swapped_share(clean, NAMES, "arm") == 0
    detected = clean.detected_px.copy()
    detected[50:80, 1:4], detected[50:80, 4:7] = (
        clean.detected_px[50:80, 4:7],
        clean.detected_px[50:80, 1:4],
    )
    swapped = DetectedClip(detected, clean.true_px, clean.height_px, "front", FPS)
    assert swapped_share(swapped, NAMES, "arm") == pytest.approx(30 / 200)


def test_white_errors_have_no_persistence() -> None:
    rng = np.random.default_rng(4)
    true = np.zeros((2000, 1, 2))
    noise = DetectedClip(
        rng.normal(0, 4.0, true.shape), true, np.full(2000, HEIGHT_PX), "front", FPS
    )
    (row,) = point_errors([noise], ["nose"])
    assert np.isnan(row.persistent)
    assert row.spread == pytest.approx(0.01, rel=0.05)
