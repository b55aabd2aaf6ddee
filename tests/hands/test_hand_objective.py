"""The linearisation of every term against finite differences of its cost."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from imocap_core.hands.hand_fit import cheapest_path
from imocap_core.hands.hand_objective import (
    CommonHand,
    HandState,
    HandViews,
    coupling_cost,
    image_cost,
    prior_cost,
    smooth_cost,
)
from imocap_core.motion.normal import NormalEquations
from imocap_core.rotations import exp
from tests.hands.test_hand_fit import PARAMS, SKELETON

WEIGHTS = replace(
    PARAMS, wrist_rad=0.7, offset_m=0.03, pose_prior=0.5, acceleration_rad_s2=30.0,
    offset_acceleration_m_s2=3.0,
)  # fmt: skip
B, T, V = 2, 4, 2
FPS = torch.tensor([15.0, 10.0]).double()


def random(*shape: int, seed: int, scale: float = 1.0) -> Tensor:
    made = torch.Generator().manual_seed(seed)
    return scale * torch.randn(*shape, generator=made, dtype=torch.float64)


VIEWS = HandViews(
    bones=SKELETON.bones,
    axes=SKELETON.axes,
    R_forearm=exp(random(B, T, V, 3, seed=0)),
    wrist_m=torch.tensor([0.1, 0.2, 3.0]).double().expand(B, T, V, 3),
    K=torch.tensor([[500.0, 0, 300], [0, 500, 200], [0, 0, 1]]).double().expand(B, V, 3, 3),
    xy_px=random(B, T, V, 21, 2, seed=1, scale=5.0) + torch.tensor([317.0, 233.0]).double(),
    weight=torch.rand(B, T, V, 21, generator=torch.Generator().manual_seed(2)).double(),
    R_body=exp(random(B, T, 3, seed=3, scale=0.1)),
    valid=torch.tensor([[True] * 4, [True, True, True, False]]),
)
STATE = HandState(
    exp(random(B, T, 3, seed=4, scale=0.02)),  # turns between frames are small, as in motion
    random(B, T, 21, seed=5, scale=0.6),
    random(B, T, V, 3, seed=6, scale=0.02),
    1.05,
)
COMMON = CommonHand(
    exp(random(B, T, 3, seed=7, scale=0.4)),
    random(B, T, 21, seed=8, scale=0.5),
    torch.rand(B, T).double(),
)
Cost = Callable[[HandState, NormalEquations | None], Tensor]
TERMS: dict[str, tuple[Cost, float]] = {
    "image": (lambda s, n: image_cost(VIEWS, s, WEIGHTS, n), 1e-6),
    "prior": (lambda s, n: prior_cost(VIEWS, s, SKELETON, WEIGHTS, n), 1e-6),
    "coupling": (lambda s, n: coupling_cost(VIEWS, s, COMMON, WEIGHTS, n), 1e-6),
    "smooth": (lambda s, n: smooth_cost(VIEWS, s, WEIGHTS, FPS, n), 0.1),  # turns add up nearly
}


@pytest.mark.parametrize("name", TERMS)
def test_gradients_are_half_of_those_of_the_cost(name: str) -> None:
    term, tolerance = TERMS[name]
    normal = NormalEquations.zeros(B, T, 24 + 3 * V, 1, STATE.angles)
    term(STATE, normal)
    step = 1e-6
    for seed in range(6):
        way = random(B, T, 24 + 3 * V, seed=20 + seed)
        there, back = (term(STATE.retract(sign * step * way), None) for sign in (1, -1))
        slope = (there - back) / (4 * step)
        told = (normal.gradient * way).sum((1, 2))
        assert torch.allclose(slope, told, rtol=tolerance, atol=tolerance * float(told.abs().max()))


def test_the_size_s_derivative_too() -> None:
    normal = NormalEquations.zeros(B, T, 24 + 3 * V, 1, STATE.angles)
    image_cost(VIEWS, STATE, WEIGHTS, normal)
    step = 1e-6
    there, back = (
        image_cost(VIEWS, replace(STATE, size=STATE.size * (1 + sign * step)), WEIGHTS)
        for sign in (1, -1)
    )
    assert torch.allclose((there - back) / (4 * step), normal.corner_gradient[:, 0], rtol=1e-5)


def test_the_cheapest_path_prefers_a_steady_wrist_to_a_slightly_cheaper_jump() -> None:
    R = exp(torch.tensor([[0.0, 0, 0], [3.0, 0, 0]]).double()).expand(3, 2, 3, 3)
    cost = torch.tensor([[0.0, 5.0], [1.0, 0.9], [0.0, 5.0]]).double()
    path = cheapest_path(cost, R, torch.tensor([0.1, 0.1]).numpy())
    assert path.tolist() == [0, 0, 0]
    dear = torch.tensor([[0.0, 500.0], [900.0, 0.0], [0.0, 500.0]]).double()
    assert cheapest_path(dear, R, torch.tensor([0.1, 0.1]).numpy()).tolist() == [0, 1, 0]
