"""Every term's analytic gradient is the derivative of its cost, and no Hessian is indefinite."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn.functional import normalize

from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.gauss_newton import linearise, objective
from imocap_core.motion.prior import mixture
from imocap_core.motion.state import FRAME_UNKNOWNS, Body, MotionState
from imocap_core.motion.terms import (
    FocalPrior,
    FootContact,
    HingeLimits,
    JointAcceleration,
    JointEvidence,
    PathCoupling,
    PathSmoothness,
    PoseCoupling,
    PosePriorTerm,
    PoseSmoothness,
    Reprojection,
    ScorePrior,
    ShapePrior,
    Term,
    View,
)
from imocap_core.motion.terms.body_priors import (
    HINGES,
    LevelCameras,
    hidden_directions,
    length_rates,
    size_direction,
)
from imocap_core.motion.terms.contact import foot_contact_share
from imocap_core.motion.terms.reprojection import whitened
from imocap_core.motion.terms.view import project, with_rigid_offset
from imocap_core.rotations import exp, inverse_right_jacobian, log

B, T, POINTS = 2, 5, 25


def normal(*size: int, seed: int = 0, spread: float = 1.0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return spread * torch.randn(*size, generator=generator, dtype=torch.float64)


@pytest.fixture(scope="module")
def state() -> MotionState:
    """Two motions of five frames, one padded frame, one free camera, two free focal lengths, two
    performers, two performances' scores in three modes."""
    valid = torch.ones(B, T, dtype=torch.bool)
    valid[1, 4] = False
    return MotionState(
        exp(normal(B, T, 24, 3, spread=0.3)),
        normal(B, T, 3, seed=1, spread=0.1) + torch.tensor([0, 0, 4.0], dtype=torch.float64),
        normal(B, 10, seed=2, spread=0.3),
        valid,
        exp(normal(B, 1, 3, seed=3, spread=0.1)),
        normal(B, 1, 3, seed=4, spread=0.1),
        normal(B, 2, seed=16, spread=0.1),
        normal(B, 1, 10, seed=17, spread=0.3),
        normal(B, 2, 3, seed=21),
    )


def seen(state: MotionState) -> torch.Tensor:
    return state.valid[..., None].double()


def reprojection(body: Body, state: MotionState) -> Term:
    K = torch.tensor([[500.0, 0, 320], [0, 500, 180], [0, 0, 1]], dtype=torch.float64)
    K = K.expand(B, 3, 3)
    eye, zero = torch.eye(3, dtype=torch.float64).expand(B, 3, 3), torch.zeros(B, 3).double()
    weight = normal(B, T, POINTS, seed=5).abs() / 25 * seen(state)
    views = [
        View(
            200 + normal(B, T, POINTS, 2, seed=6 + c, spread=100.0),
            *(weight, K, eye, zero, camera, focal),
        )
        for c, (camera, focal) in enumerate(((None, None), (0, None), (None, 1), (0, 0)))
    ]
    return Reprojection(body, tuple(views), 30.0)


def with_rigid_offsets(body: Body, state: MotionState) -> Reprojection:
    """Detections near the body, so that the inner solve converges."""
    xyz = body.positions(body.keypoints, state)
    K = torch.tensor([[500.0, 0, 320], [0, 500, 180], [0, 0, 1]], dtype=torch.float64)
    weight = normal(B, T, POINTS, seed=5).abs() / 25 * seen(state)
    eye, zero = torch.eye(3, dtype=torch.float64).expand(B, 3, 3), torch.zeros(B, 3).double()
    view = View(torch.zeros(B, T, POINTS, 2).double(), weight, K.expand(B, 3, 3), eye, zero, 0, 1)
    xy, _ = project(view.with_camera_of(state), xyz)
    noisy = xy + normal(*xy.shape, seed=20, spread=5.0)
    precision = torch.tensor([25.0] * 3 + [100.0] * 3).double().expand(B, T, 6)
    return Reprojection(body, (replace(view, xy_px=noisy, offset_precision=precision),), 30.0)


def of_two_performers(body: Body, state: MotionState) -> Reprojection:
    """Views of either performer, free and known cameras, with and without rigid offsets."""
    (offset,) = with_rigid_offsets(body, state).views
    views = reprojection(body, state).views[1:3]  # type: ignore[attr-defined]
    every = (offset, *views, *(replace(view, performer=1) for view in (offset, *views)))
    return Reprojection(body, every, 30.0)


def of_performances(body: Body, state: MotionState) -> Reprojection:
    """Views of performances that differ in modes, with and without rigid offsets and cameras."""
    (offset,) = with_rigid_offsets(body, state).views
    known, free, *_ = reprojection(body, state).views  # type: ignore[attr-defined]
    shifts = normal(B, T, POINTS, 3, 3, seed=22, spread=0.02)
    both = [replace(v, shifts=shifts, performance=p) for p, v in enumerate((offset, known))]
    return Reprojection(body, (*both, replace(free, shifts=shifts)), 30.0)


def pose_prior(_: Body, __: MotionState) -> Term:
    rng = np.random.default_rng(0)
    factor = 0.1 * rng.standard_normal((3, 69, 69))
    covariance = factor @ factor.transpose(0, 2, 1) + 0.1 * np.eye(69)
    means = 0.2 * rng.standard_normal((3, 69))
    return PosePriorTerm(mixture(means, covariance, np.ones(3) / 3, np.ones(24), np.ones(24)), 0.3)


TERMS: dict[str, Callable[[Body, MotionState], Term]] = {
    "reprojection": reprojection,
    "reprojection of two performers": of_two_performers,
    "reprojection of performances": of_performances,
    "score prior": lambda b, s: ScorePrior(),
    "pose prior": pose_prior,
    "shape prior": lambda b, s: ShapePrior.of_body(b.model, 2.0, 5.0, 9.0),
    "focal prior": lambda b, s: FocalPrior(normal(2, seed=17) / 10, normal(2, seed=18).abs()),
    "level cameras": lambda b, s: LevelCameras(
        normalize(normal(3, seed=26), dim=0), normal(1, 3, seed=27), torch.ones(1).double(), 7.0
    ),
    "limits": lambda b, s: HingeLimits(2.0),
    "velocity": lambda b, s: PoseSmoothness(normal(24).abs(), torch.zeros(24).double(), 1.0),
    "acceleration": lambda b, s: PoseSmoothness(torch.zeros(24).double(), normal(24).abs(), 0.7),
    "foot speeds": lambda b, s: FootContact(b, 40.0, 1.5),
    "foot contact": lambda b, s: FootContact(b, normal(B, T - 1, 4, seed=13).abs(), 1.5),
    "joint acceleration": lambda b, s: JointAcceleration(b, 30.0, 1e-3),
    "path": lambda b, s: PathSmoothness(3.0, 2.0),
    "pose coupling": lambda b, s: PoseCoupling(
        exp(normal(B, T, 24, 3, seed=7, spread=0.3)), normal(B, T, 24, seed=8).abs() * seen(s)
    ),
    "path coupling": lambda b, s: PathCoupling(
        normal(B, T, 3, seed=9), normal(B, T, seed=10).abs() * s.valid
    ),
    "evidence": lambda b, s: JointEvidence(
        b, normal(B, T, 24, 3, seed=11), normal(B, T, 24, seed=12).abs() * seen(s), 3.0
    ),
    "position coupling": lambda b, s: JointEvidence(
        b,
        normal(B, T, len(b.keypoints.names), 3, seed=23),
        normal(B, T, len(b.keypoints.names), seed=24).abs() * s.valid[..., None],
        3.0,
        of_keypoints=True,
    ),
    "two estimates": lambda b, s: JointEvidence(
        b,
        normal(B, T, 2, 24, 3, seed=14),
        normal(B, T, 2, 24, seed=15).abs() * s.valid[..., None, None],
        3.0,
    ),
}


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 0.3, 2.0, np.pi - 1e-3])
def test_compiled_rotations_are_those_of_tensors(angle: float) -> None:
    vectors = angle * torch.nn.functional.normalize(normal(50, 3, seed=25), dim=-1)
    torch.testing.assert_close(log(exp(vectors)), vectors, rtol=0, atol=1e-11)
    for compiled, given in ((log, exp(vectors)), (exp, vectors), (inverse_right_jacobian, vectors)):
        by_tensors = compiled(given.clone().requires_grad_()).detach()
        torch.testing.assert_close(compiled(given), by_tensors, rtol=0, atol=1e-12)


def gradients(term: Term, state: MotionState) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Of the cost, by frames and by globals: the term's, and by automatic differentiation."""
    d_frames = torch.zeros(B, T, FRAME_UNKNOWNS, dtype=torch.float64, requires_grad=True)
    d_globals = torch.zeros(B, state.unknown_globals, dtype=torch.float64, requires_grad=True)
    cost = objective([term], state.retract(d_frames, d_globals)).sum()
    expected = torch.autograd.grad(
        cost, (d_frames, d_globals), allow_unused=True, materialize_grads=True
    )
    assert max(float(x.abs().max()) for x in expected) > 1e-3, "the term does not act"
    given = linearise([term], state)
    return list(zip((given.gradient, given.corner_gradient), expected, strict=True))


@pytest.mark.parametrize("name", TERMS)
def test_gradient_is_the_derivative_of_the_cost(name: str, body: Body, state: MotionState) -> None:
    for mine, theirs in gradients(TERMS[name](body, state), state):
        scale = 1 + float(theirs.abs().max())
        assert float((2 * mine - theirs).abs().max()) / scale < 1e-9


def test_rigid_offsets_leave_the_gradient_that_of_the_cost(body: Body, state: MotionState) -> None:
    for mine, theirs in gradients(with_rigid_offsets(body, state), state):
        error = (2 * mine - theirs).norm() / theirs.norm()
        assert float(error) < 0.02  # the root's own shape is left out


def test_rigid_offsets_of_a_rotated_and_translated_performance_are_recovered(body, state):
    xyz = body.positions(body.keypoints, state)
    pivot = state.trans + body.model.shape(state.betas).joints_rest[:, 0][:, None]
    true = normal(B, T, 6, seed=21, spread=0.03)
    K = torch.tensor([[500.0, 0, 320], [0, 500, 180], [0, 0, 1]], dtype=torch.float64)
    R = torch.eye(3, dtype=torch.float64).expand(B, 3, 3)
    t = torch.tensor([0.0, 0.0, 5.0], dtype=torch.float64).expand(B, 3)
    view = View(
        torch.zeros(B, T, POINTS, 2).double(),
        0.25 * seen(state).expand(B, T, POINTS),
        K.expand(B, 3, 3),
        R,
        t,
    )
    points = with_rigid_offset(xyz, pivot, true)
    view = replace(view, xy_px=project(view, points)[0])
    found, _ = Reprojection(body, (view,), 30.0).rigid_offsets(
        view, state, torch.full_like(true, 1e-4)
    )
    error = (found - true).abs()[state.valid].amax(0)
    assert float(error[:5].max()) < 2e-3
    assert 0 < float(error[5]) < 0.05  # depth, which one view hardly determines


def test_eliminating_rigid_offsets_is_the_schur_complement() -> None:
    rows = normal(1, 2, 40, 15, seed=30)
    precision = normal(1, 2, 6, seed=31).abs() + 0.1
    whole = rows.mT @ rows
    whole[..., 9:, 9:] += torch.diag_embed(precision)
    frames, by_offset = rows[..., :9], rows[..., 9:]
    lost = whitened(by_offset, precision) @ frames
    expected = torch.linalg.inv(torch.linalg.inv(whole)[..., :9, :9])
    assert torch.allclose(frames.mT @ frames - lost.mT @ lost, expected, rtol=1e-9)


def test_an_up_counts_beyond_its_deviation_and_not_where_it_is_wrong(state: MotionState) -> None:
    turns = exp(torch.tensor([[0.04, 0.0, 0.0], [-0.04, 0.0, 0.0], [0.0, 0.0, 1.2]]).double())
    common = LevelCameras.common(-turns[..., 1], torch.full((3,), 20.0).double())
    assert float(common[1]) < -0.999
    term = LevelCameras(common, state.camera_R[0] @ common, torch.tensor([20.0]), 3.0)
    costs = [float(term.cost(replace(state, camera_R=R @ state.camera_R))[0]) for R in turns]
    assert (costs[0], costs[2] > 300.0) == (0.0, True)  # far off it counts as 10 deviations do


@pytest.mark.parametrize("name", TERMS)
def test_hessian_is_positive_semidefinite(name: str, body: Body, state: MotionState) -> None:
    found = linearise([TERMS[name](body, state)], state)
    side = T * FRAME_UNKNOWNS
    dense = torch.zeros(B, T, FRAME_UNKNOWNS, T, FRAME_UNKNOWNS, dtype=torch.float64)
    for t in range(T):
        for step, block in ((0, found.diagonal), (1, found.next1), (2, found.next2)):
            if t + step < T:
                dense[:, t, :, t + step] = block[:, t]
                dense[:, t + step, :, t] = block[:, t].transpose(-1, -2)
    lowest = torch.linalg.eigvalsh(dense.reshape(B, side, side)).amin()
    assert float(lowest) > -1e-8 * float(dense.abs().max())


@pytest.mark.parametrize("name", TERMS)
def test_padding_takes_no_part(name: str, body: Body, state: MotionState) -> None:
    term = TERMS[name](body, state)
    moved = state.trans.clone()
    moved[1, 4] += 0.5
    other = replace(state, trans=moved)
    assert torch.allclose(term.cost(state), term.cost(other), rtol=1e-12)


def test_slow_feet_stand_and_fast_ones_swing(body: Body) -> None:
    still = torch.zeros(1, 30, 3).double()
    walking = 1.5 / 30 * torch.arange(30).double()[:, None].expand(1, 30, 3)  # the whole body, m/s
    jitter = normal(1, 30, 3, spread=0.01)

    def share(trans: torch.Tensor) -> torch.Tensor:
        return foot_contact_share(body, moving_along(trans[0]), 30.0, speed_m_s=0.2)

    assert float(share(still).min()) == 1.0
    assert float(share(walking).max()) < 0.01
    assert float(share(still + jitter).median()) > 0.5  # 0.4 m/s from frame to frame


FPS = 30.0
FRAMES = 24


def moving_along(path: torch.Tensor, betas: torch.Tensor | None = None) -> MotionState:
    """The rest pose along a path (T, 3)."""
    eye = torch.eye(3, dtype=torch.float64).expand(1, len(path), 24, 3, 3)
    shape = torch.zeros(1, 10, dtype=torch.float64) if betas is None else betas
    return MotionState.of(eye, path[None], shape, torch.ones(1, len(path), dtype=torch.bool))


def path_of(accelerations: torch.Tensor) -> torch.Tensor:
    """(T, 3) metres, along x, with the given second differences."""
    x = torch.zeros(FRAMES, 3, dtype=torch.float64)
    x[2:, 0] = accelerations.cumsum(0).cumsum(0)
    return x


def test_uniform_motion_costs_nothing(body: Body) -> None:
    steps = torch.arange(FRAMES, dtype=torch.float64)[:, None] * torch.tensor([0.1, 0.0, 0.2])
    assert JointAcceleration(body, FPS, 1.0).cost(moving_along(steps)).item() < 1e-12


def test_one_spell_costs_less_than_restlessness(body: Body) -> None:
    """The same squared acceleration, once in three frames and once in all."""
    spell, restless = torch.zeros(FRAMES - 2).double(), torch.ones(FRAMES - 2).double()
    spell[9:12] = ((FRAMES - 2) / 3) ** 0.5
    term = JointAcceleration(body, FPS, 1.0)
    costs = [term.cost(moving_along(path_of(0.02 * a))).item() for a in (spell, restless)]
    assert costs[0] < 0.6 * costs[1]


def test_a_larger_body_that_accelerates_as_much_more_costs_the_same(body: Body) -> None:
    betas = torch.zeros(1, 10, dtype=torch.float64)
    betas[0, 0] = 1.5
    rest = [body.model.shape(b).joints_rest[:, 1] for b in (torch.zeros(10).double(), betas[0])]
    head, ankle = (body.joints.names.index(name) for name in ("head", "left_ankle"))
    factor = (rest[1][head] - rest[1][ankle]) / (rest[0][head] - rest[0][ankle])
    path = path_of(0.004 * torch.sin(torch.arange(FRAMES - 2, dtype=torch.float64)))
    term = JointAcceleration(body, FPS, 1.0)
    mean, large = term.cost(moving_along(path)), term.cost(moving_along(factor * path, betas))
    assert abs(factor.item() - 1) > 0.01
    torch.testing.assert_close(mean, large, rtol=1e-3, atol=0.0)


def test_frame_rate_changes_only_the_number_of_frames(body: Body) -> None:
    """A constant acceleration, filmed at two rates."""

    def cost(fps: float) -> float:
        time = torch.arange(8 * int(fps), dtype=torch.float64) / fps
        path = torch.zeros(len(time), 3, dtype=torch.float64)
        path[:, 0] = 0.5 * time**2
        return JointAcceleration(body, fps, 1.0).cost(moving_along(path)).item() / len(time)

    assert cost(60.0) == pytest.approx(cost(30.0), rel=0.02)


SLACK_RAD = 0.1


def test_the_four_hinges_cost_what_extension_beyond_the_slack_costs(state: MotionState) -> None:
    """Knees and elbows bend both ways."""
    state, weight = replace(state, R_local=exp(normal(B, T, 24, 3, seed=1, spread=0.6))), 2.0
    expected = []
    for name, k, sign in HINGES:
        flexion = sign * state.axis_angle[:, :, SMPL_JOINTS.index(name), k]
        excess = (-flexion - SLACK_RAD).clamp_min(0.0) * state.valid
        expected.append(excess.square().sum(1))
    assert torch.equal(HingeLimits(weight).cost(state), weight * torch.stack(expected).sum(0))


BODY = load_free_body()


def skeleton(betas: torch.Tensor) -> torch.Tensor:
    """Sum of all lengths between the twelve joints and of the trunk."""
    joints = BODY.shape(betas).joints_rest
    limbs = [(1, 4), (4, 7), (2, 5), (5, 8), (16, 18), (18, 20), (17, 19), (19, 21)]
    pairs = [(joints[a], joints[b]) for a, b in [*limbs, (1, 2), (16, 17)]]
    pairs.append((joints[[1, 2]].mean(0), joints[[16, 17]].mean(0)))
    return torch.stack([torch.linalg.vector_norm(a - b) for a, b in pairs]).sum()


def test_no_other_direction_makes_the_skeleton_of_the_twelve_joints_grow_as_fast() -> None:
    size = size_direction(BODY)
    rate = torch.func.grad(skeleton)(torch.zeros(10, dtype=BODY.dtype))
    torch.testing.assert_close(size, rate / rate.norm(), atol=2e-3, rtol=0)


def test_size_and_what_keypoints_do_not_tell_have_their_own_weights() -> None:
    hidden, size = hidden_directions(BODY), size_direction(BODY)
    prior = ShapePrior.of_body(BODY, 3.0, 50.0, 200.0)
    identity = torch.eye(hidden.shape[1]).to(hidden)
    torch.testing.assert_close(hidden.T @ hidden, identity)
    torch.testing.assert_close(hidden.T @ prior.precision @ hidden, 50.0 * identity)
    torch.testing.assert_close(prior.precision @ size, 200.0 * size)
    told = torch.linalg.eigvalsh(prior.precision)[: 9 - hidden.shape[1]]
    torch.testing.assert_close(told, torch.full_like(told, 3.0))


def test_hidden_shape_leaves_all_lengths_as_they_are() -> None:
    rates, hidden = length_rates(BODY), hidden_directions(BODY)
    assert hidden.shape == (10, 3)
    assert torch.linalg.matrix_rank(rates, rtol=1e-6) == 7
    torch.testing.assert_close(rates @ hidden, torch.zeros(7, 3).to(rates))


def test_people_told_to_be_wider_and_longer_in_the_leg_are_no_taller() -> None:
    """Where keypoints ask for other proportions, their sum stays that of the population."""
    rates = length_rates(BODY)
    asked = rates.new_tensor([0.03, 0.04, 0.02, 0.0, -0.07, -0.02, 0.02])  # metres
    prior = ShapePrior.of_body(BODY, 10.0, 100.0, 1000.0).precision
    # Proportions alone: what all lengths have in common is free, as it is for pictures.
    lengths = rates.new_tensor([0.39, 0.43, 0.26, 0.24, 0.17, 0.35, 0.47])
    free = torch.eye(7).to(rates) - torch.outer(lengths, lengths) / lengths.square().sum()
    told = rates.T @ free.T @ free @ rates * 1e7
    betas = torch.linalg.solve(told + prior, 1e7 * rates.T @ free.T @ free @ asked)
    grown = float(skeleton(betas) / skeleton(torch.zeros_like(betas)))
    assert abs(grown - 1) < 0.01
    torch.testing.assert_close(free @ rates @ betas, free @ asked, atol=2e-3, rtol=0)


def test_length_rates_are_the_derivatives_of_lengths() -> None:
    def thigh(betas: torch.Tensor) -> torch.Tensor:
        joints = BODY.shape(betas).joints_rest
        sides = [joints[a] - joints[b] for a, b in ((4, 1), (5, 2))]
        return torch.stack([torch.linalg.vector_norm(bone) for bone in sides]).mean()

    slope = torch.func.grad(thigh)(torch.zeros(10, dtype=BODY.dtype))
    torch.testing.assert_close(length_rates(BODY)[0], slope)
