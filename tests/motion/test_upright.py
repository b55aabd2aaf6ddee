"""Balance: a body that leans is costlier than one above its feet."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from imocap_core.camera.gravity import FilmedBody
from imocap_core.motion.monocular.fit import arms_above_support, balance_terms
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Balance
from imocap_core.params import FitParams
from imocap_core.rotations import exp
from tests.camera.standing import standing
from tests.motion.made import FACING, scene

DEPTH = torch.tensor([0.0, 0.0, 4.0], dtype=torch.float64)


def leaning(lean_rad: float, frames: int = 20) -> MotionState:
    """A body at rest that faces a level camera and leans away from it."""
    R = exp(torch.zeros(1, frames, 24, 3, dtype=torch.float64))
    lean = torch.tensor([lean_rad, 0.0, 0.0], dtype=torch.float64)
    R[:, :, 0] = exp(FACING) @ exp(-lean)
    trans = DEPTH.expand(1, frames, 3)
    valid = torch.ones(1, frames, dtype=torch.bool)
    return MotionState.of(R, trans, torch.zeros(1, 10, dtype=torch.float64), valid)


@pytest.mark.parametrize("lean_rad", [-0.8, 0.8])
def test_a_body_that_falls_is_costlier_than_one_above_its_feet(lean_rad: float) -> None:
    made = scene(20, [0.0], np.random.default_rng(0))
    steady = FitParams(camera_pitch_deg=3.0)
    (term,) = balance_terms(made.body, leaning(lean_rad), made.observations, steady)
    half, upright = term.cost(leaning(lean_rad / 2)), term.cost(leaning(0.0))
    assert float(upright) < 0.5 * float(half) < 0.5 * float(term.cost(leaning(lean_rad)))


def test_a_weight_of_0_leaves_it_out() -> None:
    made = scene(20, [0.0], np.random.default_rng(0))
    assert balance_terms(made.body, leaning(0.1), made.observations, FitParams(balance=0.0)) == []


def test_the_arm_is_from_the_middle_of_the_feet_to_the_centre_of_mass() -> None:
    joints = standing(10)
    filmed = FilmedBody(joints, 25.0, np.eye(3))
    weights, whiten = arms_above_support(filmed, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(weights.sum(axis=1), 0.0, atol=1e-12)
    arm = np.einsum("tj,tjc->tc", weights, joints)
    assert (arm[:, 1] > 0.8).all()
    assert (np.linalg.norm(whiten @ arm[..., None], axis=1) < 1).all()
    np.testing.assert_allclose(whiten @ [0.0, 1.0, 0.0], 0.0, atol=1e-12)


def test_a_motion_of_the_batch_by_itself_has_its_frames() -> None:
    made = scene(20, [0.0], np.random.default_rng(0))
    (term,) = balance_terms(made.body, leaning(0.3), made.observations, FitParams())
    assert isinstance(term, Balance)
    short = leaning(0.3, frames=5)
    assert float(term.of(0, 5).cost(short)[0]) < float(term.cost(leaning(0.3))[0])
