"""What bounds the memory of long motions changes no result: pieces of frames, factors in place."""

from dataclasses import fields

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.motion import gauss_newton as gauss_newton_module
from imocap_core.motion.gauss_newton import gauss_newton, linearise, motions_at_once
from imocap_core.motion.monocular import starts
from imocap_core.motion.monocular.fit import monocular_terms
from imocap_core.motion.monocular.starts import make_library, match
from imocap_core.motion.normal import NormalEquations, solve_pentadiagonal
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import base
from tests.motion.made import WEIGHTS, scene, wide_prior
from tests.motion.test_normal import banded
from tests.motion.test_solver import disturbed
from tests.motion.test_terms import TERMS, body, state, with_rigid_offsets

__all__ = ["body", "state"]  # fixtures


IN_PIECES = [
    "reprojection of two performers", "with_rigid_offsets", "foot contact", "joint acceleration",
    "balance", "two estimates",
]  # fmt: skip


@pytest.mark.parametrize("name", IN_PIECES)
def test_equations_in_pieces_are_those_of_the_whole(
    body: Body, state: MotionState, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    make = {**TERMS, "with_rigid_offsets": with_rigid_offsets}[name]
    whole = linearise([make(body, state)], state)
    monkeypatch.setattr(base, "PIECE", 2)
    parts = linearise([make(body, state)], state)
    for field in fields(NormalEquations):
        found, expected = getattr(parts, field.name), getattr(whole, field.name)
        assert torch.allclose(found, expected, rtol=1e-10, atol=1e-9), field.name


@pytest.mark.parametrize("frames", [2, 3, 6, 75])
def test_factors_in_place_give_the_same_bits_and_take_the_system(frames: int) -> None:
    diagonal, next1, next2, _ = banded(frames, 4, accelerations=True)
    right = torch.randn(frames, 4, 3, generator=torch.Generator().manual_seed(1)).double()
    expected = solve_pentadiagonal(diagonal[0], next1[0], next2[0], right)
    system = [x.clone() for x in (diagonal[0], next1[0], next2[0], right)]
    found = solve_pentadiagonal(*system, in_place=True)
    assert torch.equal(found, expected)
    assert frames == 2 or not torch.equal(system[0], diagonal[0])


def test_one_long_motion_after_another_gives_the_same_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = scene(11, [0.0], np.random.default_rng(3))
    start = disturbed(made.state.rows(torch.tensor([0, 0])), 0.1)
    two = made.observations * 2
    terms = monocular_terms(made.body, wide_prior(), two, start.trans, WEIGHTS, 1.0)
    for shared in (False, True):
        expected = gauss_newton(terms, start, max_steps=4, shared_globals=shared)
        with monkeypatch.context() as patch:
            patch.setattr(gauss_newton_module, "MOST_HELD", 12)
            patch.setattr(base, "PIECE", 4)
            found = gauss_newton(terms, start, max_steps=4, shared_globals=shared)
        assert found.costs == pytest.approx(expected.costs, rel=1e-10)
        assert torch.allclose(found.state.R_local, expected.state.R_local, atol=1e-9)


def test_fewer_long_motions_are_worked_on_at_once() -> None:
    assert motions_at_once(gauss_newton_module.MOST_HELD // 3) == 3
    assert motions_at_once(10 * gauss_newton_module.MOST_HELD) == 1


def test_frames_matched_in_blocks_have_the_same_candidates(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    body, rng = Body.of(load_free_body(), "body25"), np.random.default_rng(0)
    library = make_library(body, load_pose_prior(), rng, poses=40, directions=12)
    xy = torch.as_tensor(rng.uniform(100, 300, (5, 25, 2)))
    weight = torch.as_tensor(rng.uniform(0.2, 1.0, (5, 25)))
    expected = match(library, xy, weight, count=4, sigma=0.1)
    monkeypatch.setattr(starts, "FRAMES", 2)
    found = match(library, xy, weight, count=4, sigma=0.1)
    assert torch.allclose(found.cost, expected.cost)
    assert torch.allclose(found.R_local, expected.R_local)
