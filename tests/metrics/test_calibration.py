"""Normalised errors are 1 when claims are honest, and say by which factor they are not."""

import numpy as np
import pytest

from benchmarks.sync_reliability import expected_calibration_error
from imocap_core.metrics.calibration import (
    along_and_across,
    coverage_error,
    covered_share,
    normalised_error,
    normalised_errors,
    probability_content,
    total_sigma,
)


def test_honest_claims_give_one_and_doubled_ones_a_half() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T
    errors = rng.multivariate_normal(np.zeros(3), covariance, (4000, 2))
    sigma = np.broadcast_to(total_sigma(covariance), (4000, 2))
    length = np.linalg.norm(errors, axis=-1)
    assert normalised_error(length, sigma) == pytest.approx(1, abs=0.03)
    assert normalised_errors(length, 2 * sigma) == pytest.approx([0.5, 0.5], abs=0.03)


def test_variance_is_split_between_along_and_across() -> None:
    along, across = along_and_across(np.diag([1.0, 4.0, 9.0]), np.array([0.0, 0.0, 1.0]))
    assert along == pytest.approx(3)
    assert across == pytest.approx(np.sqrt(5))
    tilted = np.array([0.6, 0.0, 0.8])
    along, across = along_and_across(np.diag([1.0, 4.0, 9.0]), tilted)
    assert along**2 + across**2 == pytest.approx(14)


def test_regions_of_honest_claims_hold_what_they_claim_and_small_ones_less() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T
    errors = rng.multivariate_normal(np.zeros(3), covariance, (5000, 2))
    claims = np.broadcast_to(covariance, (5000, 2, 3, 3))
    honest, small, large = (probability_content(errors, k * claims) for k in (1.0, 0.25, 4.0))
    for level in (0.5, 0.8, 0.9):
        assert covered_share(honest, level) == pytest.approx(level, abs=0.02)
        assert covered_share(small, level) < level - 0.1 < level < covered_share(large, level)
    assert coverage_error(honest) < 0.02
    assert min(coverage_error(small), coverage_error(large)) > 0.2
    turn = np.linalg.qr(root)[0]
    turned = probability_content(errors @ turn.T, turn @ claims @ turn.T)
    np.testing.assert_allclose(turned, honest, atol=1e-9)


def test_unknown_claims_cover_nothing() -> None:
    errors, claims = np.zeros((2, 3)), np.stack([np.eye(3), np.full((3, 3), np.nan)])
    content = probability_content(errors, claims)
    assert content[0] == 0
    assert np.isnan(content[1])
    assert covered_share(content, 0.5) == 1
    assert np.isnan(coverage_error(content[1:]))


def test_what_is_unknown_is_left_out() -> None:
    errors, sigmas = np.array([3.0, np.nan, 1.0]), np.array([1.0, 1.0, np.nan])
    assert normalised_error(errors, sigmas) == pytest.approx(3)
    assert np.isnan(normalised_error(np.array([np.nan]), np.array([1.0])))


@pytest.mark.usefixtures("unchecked_shapes")
def test_shapes_that_do_not_fit_are_named() -> None:
    with pytest.raises(ValueError, match=r"both be \(T, J\), got \(4, 2\) and \(4, 3\)"):
        normalised_errors(np.ones((4, 2)), np.ones((4, 3)))


def test_the_calibration_error_is_the_gap_between_claim_and_truth() -> None:
    confidence = np.array([0.9] * 10 + [0.5] * 10)
    honest = np.array([True] * 9 + [False] + [True] * 5 + [False] * 5)
    assert expected_calibration_error(confidence, honest) == pytest.approx(0.0)
    assert expected_calibration_error(confidence, np.zeros(20, bool)) == pytest.approx(0.7)
    assert expected_calibration_error(np.ones(4), np.array([True, True, True, False])) == 0.25
