"""The distinct motions of one video: reversals of the best fit, refitted, cheapest first; the
packaged mixture of poses."""

from dataclasses import fields
from itertools import combinations, pairwise

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion import gauss_newton as gauss_newton_module
from imocap_core.motion.gauss_newton import gauss_newton, linearise, motions_at_once
from imocap_core.motion.monocular import starts
from imocap_core.motion.monocular.fit import fit_monocular, monocular_terms
from imocap_core.motion.monocular.hypotheses import DISTINCT_M, alternatives, reversed_starts
from imocap_core.motion.monocular.starts import (
    MIN_JOINTS,
    Library,
    fit_rotations_to_joints,
    make_library,
    match,
    start_at_joints,
    start_at_motion,
)
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import TWINS, Body, MotionState
from imocap_core.motion.terms import base
from imocap_core.rotations import exp, geodesic_angle
from tests.motion.made import WEIGHTS, Made, scene, wide_prior
from tests.motion.test_gauss_newton import disturbed
from tests.motion.test_terms import TERMS, state, with_rigid_offsets

LEGS = ("hip", "knee", "ankle", "foot")
DEPTH = torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64)


@pytest.fixture(scope="module")
def made() -> Made:
    return scene(18, [0.0, 1.0], np.random.default_rng(3))


@pytest.fixture(scope="module")
def library(made: Made) -> Library:
    rng = np.random.default_rng(0)
    return make_library(made.body, load_pose_prior(), rng, poses=100, directions=8)


def about_root(made: Made, motion: MotionState) -> torch.Tensor:
    xyz = made.body.positions(made.body.joints, motion)[0]
    return xyz - xyz[:, :1]


def test_reversed_sides_are_the_reflection_in_depth(made: Made, library: Library) -> None:
    motion = made.state.of_motion(0, 18)
    motion = MotionState.of(
        motion.R_local, motion.trans, torch.zeros_like(motion.betas), motion.valid
    )
    start = reversed_starts(made.body, library, motion, made.observations[0])["sides"]
    other = MotionState.of(start.R_local[None], start.trans[None], motion.betas, motion.valid)
    reflected = about_root(made, motion)[:, TWINS] * DEPTH
    apart = (about_root(made, other) - reflected).norm(dim=-1)
    assert float(apart.max()) < 0.03  # the body is symmetric to within that


@pytest.mark.long
def test_alternatives_are_distinct_and_in_order_of_cost(made: Made, library: Library) -> None:
    prior, observations = load_pose_prior(), made.observations[:2]
    starts = [[start_at_joints(made.body, made.state.R_local[0], o)] for o in observations]
    fit = fit_monocular(made.body, prior, observations, starts, WEIGHTS, stride=3, max_steps=4)
    found = alternatives(
        made.body, prior, library, observations, fit.coarse, WEIGHTS, videos=[1], count=3
    )
    assert found[0] == []
    assert 1 <= len(found[1]) <= 3
    costs = [h.cost for h in found[1]]
    assert all(a <= b for a, b in pairwise(costs))
    poses = [about_root(made, h.motion) for h in found[1]]
    poses.append(about_root(made, fit.state.of_motion(1, 18)))
    assert all(pose.shape == (18, 24, 3) for pose in poses)
    apart = [float((a - b).norm(dim=-1).mean()) for a, b in combinations(poses, 2)]
    assert min(apart) > 0.7 * DISTINCT_M  # measured on every third frame, before the last fit


@pytest.fixture(scope="module")
def small_library(body: Body) -> Library:
    rng = np.random.default_rng(0)
    return make_library(body, load_pose_prior(), rng, poses=40, directions=4)


def test_library_poses_are_found_again_from_the_joints_that_are_there(body, small_library):
    rng = np.random.default_rng(1)
    turn = exp(torch.as_tensor(rng.normal(size=(5, 3))))
    joints = (small_library.joints[:5] @ turn.transpose(-1, -2)).numpy() + rng.normal(
        size=(5, 1, 3)
    )
    joints[1, 3] = np.nan
    joints[2] = np.nan
    joints[3, MIN_JOINTS - 1 :] = np.nan
    found = fit_rotations_to_joints(body, small_library, joints)
    for t in (0, 1, 4):
        assert torch.allclose(found[t, 1:], small_library.R_local[t, 1:], atol=1e-6)
    apart = geodesic_angle(found[1], found[4])
    assert torch.allclose(geodesic_angle(found[1], found[2]), apart / 3, atol=1e-6)
    assert torch.allclose(geodesic_angle(found[3], found[4]), apart / 3, atol=1e-6)
    with pytest.raises(ValueError, match="no frame has 6 joints"):
        fit_rotations_to_joints(body, small_library, joints[2:4])


def test_missing_frames_of_a_motion_lie_between_their_neighbours() -> None:
    R_local = exp(torch.full((5, 24, 3), 0.1).double().cumsum(0))
    trans = torch.arange(15.0).double().reshape(5, 3)
    holed, path = R_local.clone(), trans.clone()
    holed[1, 7], path[3, 0] = torch.nan, torch.nan
    start = start_at_motion(holed, path)
    assert torch.allclose(start.R_local, R_local, atol=1e-9)
    assert torch.allclose(start.trans, trans)
    with pytest.raises(ValueError, match="every frame"):
        start_at_motion(holed[1:2], path[1:2])


__all__ = ["state"]  # a fixture


IN_PIECES = [
    "reprojection of two performers", "with_rigid_offsets", "foot contact", "joint acceleration",
    "two estimates",
]  # fmt: skip


@pytest.mark.parametrize("name", IN_PIECES)
def test_equations_in_pieces_are_those_of_the_whole(body, state, monkeypatch, name):
    make = {**TERMS, "with_rigid_offsets": with_rigid_offsets}[name]
    whole = linearise([make(body, state)], state)
    monkeypatch.setattr(base, "PIECE", 2)
    parts = linearise([make(body, state)], state)
    for field in fields(NormalEquations):
        found, expected = getattr(parts, field.name), getattr(whole, field.name)
        assert torch.allclose(found, expected, rtol=1e-10, atol=1e-9), field.name


def test_one_long_motion_after_another_gives_the_same_steps(monkeypatch):
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


def test_frames_matched_in_blocks_have_the_same_candidates(monkeypatch: pytest.MonkeyPatch) -> None:
    body, rng = Body.of(load_free_body(), "body25"), np.random.default_rng(0)
    library = make_library(body, load_pose_prior(), rng, poses=40, directions=12)
    xy = torch.as_tensor(rng.uniform(100, 300, (5, 25, 2)))
    weight = torch.as_tensor(rng.uniform(0.2, 1.0, (5, 25)))
    expected = match(library, xy, weight, count=4, sigma=0.1)
    monkeypatch.setattr(starts, "FRAMES", 2)
    found = match(library, xy, weight, count=4, sigma=0.1)
    assert torch.allclose(found.cost, expected.cost)
    assert torch.allclose(found.R_local, expected.R_local)


def _flexion_deg(theta: np.ndarray, joint: str, sign: float = 1.0, axis: int = 0) -> np.ndarray:
    """(N, 2) of both sides, degrees."""
    columns = [3 * (SMPL_JOINTS.index(f"{s}_{joint}") - 1) + axis for s in ("left", "right")]
    return np.asarray(sign * np.degrees(theta[:, columns]))


def test_samples_are_those_drawn_one_by_one() -> None:
    prior, count, spread = load_pose_prior(), 50, 0.7
    weight = prior.weight.numpy()
    rng = np.random.default_rng(3)
    component = rng.choice(len(weight), size=count, p=weight / weight.sum())
    noise = rng.standard_normal((count, 69))
    expected = [
        prior.mean[c].numpy() + spread * prior.cholesky[c].numpy() @ n
        for c, n in zip(component, noise, strict=True)
    ]
    sampled = prior.sample(count, np.random.default_rng(3), spread)
    np.testing.assert_allclose(sampled, expected, atol=1e-12)
    assert len(set(component)) > 2


def test_the_best_component_is_the_likeliest_and_of_hidden_legs_by_all_but_them() -> None:
    prior, legs = load_pose_prior(), torch.zeros(69, dtype=torch.bool)
    legs[[k for k in range(69) if SMPL_JOINTS[1 + k // 3].endswith(LEGS)]] = True
    theta = torch.as_tensor(prior.sample(40, np.random.default_rng(1)))
    covariance = prior.cholesky @ prior.cholesky.mT
    for given, rest in ((prior, legs | True), (prior.of_hidden_legs, ~legs)):
        seen = theta * rest  # the legs stand
        spread = covariance[:, rest][:, :, rest]
        density = torch.distributions.MultivariateNormal(prior.mean[:, rest], spread)
        likelihood = density.log_prob(seen[:, None, rest]) + prior.weight.log()
        cost, component = given.best(seen)
        assert bool((component == likelihood.argmax(1)).all())
        expected = -2 * (likelihood.amax(1) - likelihood[0].amax())
        torch.testing.assert_close(cost - cost[0], expected, rtol=1e-5, atol=1e-4)
    weight, names = np.tile([1.0, 1.0, 0.2], (100, 1)), ("nose", "left_hip", "left_knee")
    assert prior.for_keypoints(names, [weight]) is prior.of_hidden_legs
    weight[:50, 2] = 1.0
    assert prior.for_keypoints(names, [weight, 0.0 * weight]) is prior


def test_standing_people_stand_straight() -> None:
    prior = load_pose_prior()
    drawn = prior.sample(4000, np.random.default_rng(0))
    for poses in (prior.mean.numpy(), drawn):
        knees = _flexion_deg(poses, "knee").mean(1)
        hips = _flexion_deg(poses, "hip", -1.0).mean(1)
        standing = (knees < 30) & (hips < 15)
        assert standing.sum() >= 5
        assert np.median(knees[standing]) < 8


def test_there_is_a_component_for_what_people_do() -> None:
    mean = load_pose_prior().mean.numpy()
    knees, hips = _flexion_deg(mean, "knee"), _flexion_deg(mean, "hip", -1.0)
    elbows = np.abs(_flexion_deg(mean, "elbow", axis=1))
    straight, low = (knees < 12).all(1), (knees > 70).all(1)
    assert (straight & (hips < 15).all(1)).sum() >= 5  # standing, lying, planks
    assert (low & (hips > 70).all(1)).any()  # squats, seats
    assert (low & (hips < 40).all(1)).any()  # kneeling, bridges
    assert ((knees < 35).all(1) & (hips > 40).all(1)).any()  # folded over straight legs
    assert (np.ptp(knees, 1) > 30).any()  # kicks, lunges
    assert (straight & (elbows > 90).all(1)).any()  # hands at the head
    assert (straight & (elbows < 30).all(1)).sum() >= 2  # hanging, raised


def test_bending_straight_legs_costs_and_straightening_them_does_not() -> None:
    prior = load_pose_prior()
    standing = prior.mean[(prior.mean[:, 9] < 0.2) & (prior.mean[:, 12] < 0.2)]
    bent = standing.clone()
    bent[:, [9, 12]] += 0.6
    bent[:, [0, 3]] -= 0.3
    assert bool((prior.best(standing)[0] < prior.best(bent)[0]).all())
    assert torch.isfinite(prior.best(bent)[0]).all()
