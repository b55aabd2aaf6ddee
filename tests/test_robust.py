"""Robust losses: a weight is the derivative of its cost, for numpy and torch alike."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from imocap_core.robust import cauchy, geman_mcclure, geman_mcclure_weight

SQUARES = st.lists(st.floats(0.0, 1e6), min_size=1, max_size=8)
SCALES = st.floats(0.05, 50.0)


@pytest.mark.parametrize("loss", [geman_mcclure, cauchy])
@given(squares=SQUARES, scale=SCALES)
def test_the_weight_is_the_derivative_of_the_cost(loss, squares, scale) -> None:
    squared = torch.tensor(squares, dtype=torch.float64, requires_grad=True)
    cost, weight = loss(squared, scale)
    (slope,) = torch.autograd.grad(cost.sum(), squared)
    torch.testing.assert_close(slope, weight)
    assert ((weight > 0) & (weight <= 1)).all()


@given(squares=SQUARES, scale=SCALES)
def test_numpy_torch_and_both_ways_to_the_weight_agree(squares, scale) -> None:
    squared = np.array(squares)
    cost, weight = geman_mcclure(squared, scale)
    of_torch = geman_mcclure(torch.tensor(squared), scale)
    np.testing.assert_allclose(cost, of_torch[0].numpy(), rtol=1e-14)
    np.testing.assert_allclose(weight, of_torch[1].numpy(), rtol=1e-14)
    np.testing.assert_allclose(geman_mcclure_weight(np.sqrt(squared), scale), weight, rtol=1e-10)
    prior = np.full_like(squared, 0.3)
    doubly = geman_mcclure_weight(np.sqrt(squared), scale, prior=prior)
    np.testing.assert_allclose(doubly, 0.3 * weight, rtol=1e-10)


def test_geman_mcclure_is_quadratic_near_zero_and_bounded() -> None:
    cost, weight = geman_mcclure(np.array([0.0, 1e-6, 16.0, 1e12]), 4.0)
    assert cost[1] == pytest.approx(1e-6, rel=1e-6)
    assert cost[2] == pytest.approx(8.0)
    assert cost[3] == pytest.approx(16.0, rel=1e-9)
    assert weight[[0, 2]] == pytest.approx([1.0, 0.25])


def test_cauchy_is_quadratic_near_zero_and_logarithmic_far_away() -> None:
    squared = torch.tensor([0.0, 1e-6, 16.0, 1e12], dtype=torch.float64, requires_grad=True)
    cost, weight = cauchy(squared, 4.0)
    (slope,) = torch.autograd.grad(cost.sum(), squared)
    assert torch.allclose(slope, weight)
    cost = cost.detach()
    assert float(cost[1]) == pytest.approx(1e-6, rel=1e-6)
    assert float(cost[2]) == pytest.approx(16 * np.log(2))
    assert float(cost[3]) == pytest.approx(16 * np.log(1e12 / 16), rel=1e-6)
