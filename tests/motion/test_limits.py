"""Knees and elbows against a slow twin and finite differences."""

import torch

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.gauss_newton import linearise
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms import HingeLimits, Term
from imocap_core.motion.terms.body_priors import HINGES
from imocap_core.rotations import exp

SLACK_RAD = 0.1


def state_of(theta: torch.Tensor) -> MotionState:
    """theta: (B, T, 24, 3)."""
    B, T = theta.shape[:2]
    valid = torch.ones(B, T, dtype=torch.bool)
    valid[-1, -1] = False
    zeros = theta.new_zeros
    return MotionState.of(exp(theta), zeros(B, T, 3), zeros(B, 10), valid)


def violated(seed: int = 0) -> MotionState:
    """Two motions of five frames; knees and elbows bend both ways."""
    generator = torch.Generator().manual_seed(seed)
    return state_of(torch.randn(2, 5, 24, 3, generator=generator, dtype=torch.float64) * 0.6)


def test_the_four_hinges_cost_what_extension_beyond_the_slack_costs() -> None:
    state, weight = violated(1), 2.0
    expected = []
    for name, k, sign in HINGES:
        flexion = sign * state.axis_angle[:, :, SMPL_JOINTS.index(name), k]
        excess = (-flexion - SLACK_RAD).clamp_min(0.0) * state.valid
        expected.append(excess.square().sum(1))
    assert torch.equal(HingeLimits(weight).cost(state), weight * torch.stack(expected).sum(0))


def differences(term: Term, state: MotionState) -> torch.Tensor:
    """(B, T, n) central differences of the cost."""
    B, T = state.valid.shape
    step, slopes = 1e-6, torch.zeros(B, T, FRAME_UNKNOWNS, dtype=torch.float64)
    nothing = torch.zeros(B, state.unknown_globals, dtype=torch.float64)
    for t in range(T):
        for k in range(72):
            move = torch.zeros(B, T, FRAME_UNKNOWNS, dtype=torch.float64)
            move[:, t, k] = step
            ends = (term.cost(state.retract(sign * move, nothing)) for sign in (1, -1))
            slopes[:, t, k] = torch.sub(*ends) / (2 * step)
    return slopes


def test_the_gradient_is_that_of_finite_differences() -> None:
    state, term = violated(2), HingeLimits(3.0)
    gradient = 2 * linearise([term], state).gradient
    assert float((gradient - differences(term, state)).abs().max()) < 1e-6


def test_nothing_acts_within_the_ranges() -> None:
    theta = torch.zeros(1, 2, 24, 3, dtype=torch.float64)
    state = state_of(theta)
    assert HingeLimits(5.0).cost(state).tolist() == [0.0]
    assert not linearise([HingeLimits(5.0)], state).gradient.any()
