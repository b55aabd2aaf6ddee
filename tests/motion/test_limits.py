"""Soft limits of the joints against a slow twin, finite differences and the body's directions."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.solver.objective import linearise
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms import HingeLimits, JointLimits, Term
from imocap_core.motion.terms.joint_ranges import HINGES, JOINT_RANGES, ComponentRange
from imocap_core.rotations import exp

SLACK_RAD = 0.1
PLACE = {(SMPL_JOINTS[r.joint], r.component): r for r in JOINT_RANGES}


def state_of(theta: torch.Tensor) -> MotionState:
    """theta: (B, T, 24, 3)."""
    B, T = theta.shape[:2]
    valid = torch.ones(B, T, dtype=torch.bool)
    valid[-1, -1] = False
    zeros = theta.new_zeros
    return MotionState.of(exp(theta), zeros(B, T, 3), zeros(B, 10), valid)


def violated(seed: int = 0) -> MotionState:
    """Two motions of five frames; about half of the bounded components are beyond their range."""
    generator = torch.Generator().manual_seed(seed)
    return state_of(torch.randn(2, 5, 24, 3, generator=generator, dtype=torch.float64) * 0.6)


def naive_cost(state: MotionState, weight: float, ranges: Sequence[ComponentRange]) -> list[float]:
    theta, costs = state.axis_angle.numpy(), []
    for b in range(len(theta)):
        total = 0.0
        for t in range(theta.shape[1]):
            for joint, k, lower, upper in ranges:
                angle = theta[b, t, joint, k]
                beyond = max(0.0, lower - SLACK_RAD - angle, angle - upper - SLACK_RAD)
                total += beyond**2 if state.valid[b, t] else 0.0
        costs.append(weight * total)
    return costs


@pytest.mark.parametrize("term", [HingeLimits(3.0), JointLimits(3.0)], ids=["hinges", "joints"])
def test_the_cost_is_that_of_its_slow_twin(term: JointLimits) -> None:
    state = violated()
    assert term.cost(state).tolist() == pytest.approx(naive_cost(state, 3.0, term.ranges))
    assert float(term.cost(state).min()) > 0


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


@pytest.mark.parametrize("term", [HingeLimits(3.0), JointLimits(3.0)], ids=["hinges", "joints"])
def test_the_gradient_is_that_of_finite_differences(term: JointLimits) -> None:
    state = violated(2)
    gradient = 2 * linearise([term], state).gradient
    assert float((gradient - differences(term, state)).abs().max()) < 1e-6


def test_nothing_acts_within_the_ranges() -> None:
    theta = torch.zeros(1, 2, 24, 3, dtype=torch.float64)
    state = state_of(theta)
    assert JointLimits(5.0).cost(state).tolist() == [0.0]
    assert not linearise([JointLimits(5.0)], state).gradient.any()


def test_every_joint_but_the_pelvis_is_bounded_and_sides_mirror_each_other() -> None:
    assert {SMPL_JOINTS[r.joint] for r in JOINT_RANGES} == set(SMPL_JOINTS[1:])
    for (name, k), r in PLACE.items():
        assert -math.pi < r.lower_rad <= 0 <= r.upper_rad < math.pi
        if name.startswith("left_"):
            twin = PLACE[name.replace("left_", "right_"), k]
            mirrored = (r.lower_rad, r.upper_rad) if k == 0 else (-r.upper_rad, -r.lower_rad)
            assert (twin.lower_rad, twin.upper_rad) == mirrored
        elif not name.startswith("right_") and k > 0:
            assert r.lower_rad == -r.upper_rad


# joint, component, the point that moves, the direction of the wider of the two bounds
WIDER = [
    ("spine1", 0, "head", (0, 0, 1)),  # flexion
    ("left_hip", 0, "left_ankle", (0, 0, 1)),  # flexion
    ("right_hip", 2, "right_ankle", (-1, 0, 0)),  # abduction
    ("left_knee", 0, "left_ankle", (0, 0, -1)),  # flexion
    ("right_ankle", 0, "right_foot", (0, -1, 0)),  # plantar flexion
    ("left_collar", 2, "left_wrist", (0, 1, 0)),  # elevation
    ("right_shoulder", 2, "right_wrist", (0, -1, 0)),  # lowering
    ("left_shoulder", 1, "left_wrist", (0, 0, 1)),  # horizontal flexion
    ("left_elbow", 1, "left_wrist", (0, 0, 1)),  # flexion
    ("right_elbow", 1, "right_wrist", (0, 0, 1)),
    ("right_wrist", 1, "right_hand", (0, 0, -1)),  # ulnar deviation
]


@pytest.mark.parametrize(("joint", "component", "point", "direction"), WIDER)
def test_the_wider_bound_is_the_anatomical_direction(
    joint: str, component: int, point: str, direction: tuple[int, int, int]
) -> None:
    model, limits = load_free_body(), PLACE[joint, component]
    wide = limits.upper_rad if limits.upper_rad > -limits.lower_rad else limits.lower_rad
    theta = torch.zeros(2, 24, 3, dtype=torch.float64)
    theta[1, SMPL_JOINTS.index(joint), component] = 0.1 * math.copysign(1, wide)
    shaped = model.shape(torch.zeros(10, dtype=torch.float64))
    joints = shaped.pose(exp(theta), torch.zeros(2, 3, dtype=torch.float64)).joints.numpy()
    moved = joints[1, SMPL_JOINTS.index(point)] - joints[0, SMPL_JOINTS.index(point)]
    assert np.dot(moved, direction) > 0.8 * np.linalg.norm(moved) > 0
