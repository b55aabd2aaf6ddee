"""Degraded footage and its scores: laws on small made pictures."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.detector.degradations import (
    DEGRADATIONS,
    LEGS,
    halved,
    hidden_legs,
    motion_blur,
    second_person,
)
from benchmarks.detector.measure import PerformerLimbs, best_shift, errors, score_of
from benchmarks.detector.reference import shifted


def limbs(x: float = 60.0) -> np.ndarray:
    """Somebody who stands at x: 12 joints, left, then right."""
    rows = np.array([30, 50, 70, 70, 100, 130], float)
    left, right = np.column_stack([x + 0 * rows + 8, rows]), np.column_stack([x + 0 * rows, rows])
    return np.concatenate([left, right])


def picture() -> np.ndarray:
    return np.random.default_rng(0).integers(1, 255, (160, 200, 3)).astype(np.uint8)


def test_legs_are_black_in_the_middle_third_alone() -> None:
    plain = picture()
    hidden = hidden_legs(plain, limbs(), 0.5)
    assert all(not hidden[int(y), int(x)].any() for x, y in limbs()[LEGS])
    assert np.array_equal(hidden[:60], plain[:60])
    assert np.array_equal(hidden_legs(plain, limbs(), 0.1), plain)
    assert np.array_equal(hidden_legs(plain, limbs(), 0.9), plain)


def test_the_second_person_is_the_first_s_mirror_image_and_leaves_most_of_it() -> None:
    plain = picture()
    pasted = second_person(plain, limbs(), 0.5)
    changed = (pasted != plain).any(axis=2).any(axis=0)
    assert 0 < changed.sum() < 60
    assert np.flatnonzero(changed)[0] > 60  # beside, not over
    assert np.array_equal(plain, picture())


def test_blur_and_halving_keep_the_mean_and_their_sizes() -> None:
    plain = picture()
    assert motion_blur(plain, limbs(), 0.0).shape == plain.shape
    assert halved(plain, limbs(), 0.0).shape == (80, 100, 3)
    for change in (motion_blur, halved):
        assert change(plain, limbs(), 0.0).mean() == pytest.approx(plain.mean(), rel=0.02)
        assert change(plain, limbs(), 0.0).std() < 0.8 * plain.std()
    assert len({degradation.name for degradation in DEGRADATIONS}) == len(DEGRADATIONS)


def walk(frames: int = 12) -> np.ndarray:
    return np.stack([limbs(40 + 5 * t) for t in range(frames)])


def result(xy: np.ndarray) -> PerformerLimbs:
    return PerformerLimbs(np.arange(len(xy)), xy, 1.0, 1.0)


def test_exact_detections_have_no_errors_and_missing_ones_count() -> None:
    row = errors(result(walk()), walk()) | {"people": 1.0, "ms": 1.0}
    exact = score_of("a", "plain", [row])
    assert (exact.followed_pct, exact.error_pct, exact.pck_1, exact.swapped) == (100, 0, 100, 0)
    missing = walk()
    missing[:6] = np.nan
    row = errors(result(missing), walk()) | {"people": 1.0, "ms": 1.0}
    half = score_of("a", "plain", [row])
    assert (half.followed_pct, half.error_pct, half.pck_2, half.swapped) == (50, 0, 50, 0)


def test_swapped_bodies_are_counted() -> None:
    row = errors(result(np.roll(walk(), 6, axis=1)), walk())
    assert np.asarray(row["swapped"]).all()


@pytest.mark.parametrize("by", [-3, 0, 2])
def test_the_shift_of_the_reference_is_estimated(by: int) -> None:
    assert best_shift(result(shifted(walk(), by)), walk()) == by
    assert np.isnan(shifted(walk(), by)).any() == (by != 0)
