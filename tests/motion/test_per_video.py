"""Each video's own deviations: which feet are held, and where a fit goes on from."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from imocap_core.motion.gauss_newton import linearise
from imocap_core.motion.multiview.per_video import (
    CONTACT_SCALE,
    COUPLED,
    LEAST_SPREAD_M,
    CouplingTargets,
    at_video_frames,
    deviation_terms,
    facing_agreement,
    fit_deviations,
    foot_contact_term,
    frames_lost,
    pooled_spread_m,
    position_coupling,
    targets_of,
)
from imocap_core.motion.multiview.scene import (
    DeviationSpread,
    Scene,
    consensus_motion,
    nearest_true,
)
from imocap_core.motion.state import Body, MotionState
from imocap_core.robust import finite_median
from imocap_core.rotations import exp, geodesic_angle
from imocap_core.sync.warp.template import OFFSET_START
from tests.motion.made import FRAMES, WEIGHTS, Made, filmed, mpjpe_mm
from tests.motion.test_smpl_ba import OPTIONS, disturbed, in_own_axes, whole

OFFSETS = np.tile(OFFSET_START, (3, 1))
FULL = (30.0 / WEIGHTS.foot_hold_m_s) ** 2  # weight of a step between frames at 30 a second


def moving(state: MotionState, speed_m_s: Tensor) -> MotionState:
    """The first frame's pose, carried along x at a speed (B,) of its own."""
    seconds = torch.arange(state.trans.shape[1], dtype=torch.float64) / 30.0
    way = torch.zeros_like(state.trans)
    way[..., 0] = speed_m_s[:, None] * seconds
    return replace(
        state, R_local=state.R_local[:, :1].expand_as(state.R_local), trans=state.trans[:, :1] + way
    )


def speeds(*m_s: float) -> Tensor:
    return torch.tensor(m_s, dtype=torch.float64)


def weight(made: Made, common_m_s: Tensor, own_m_s: Tensor) -> Tensor:
    """(B,) how feet are held when the common motion and the own ones travel so fast."""
    state = in_own_axes(made)
    term = foot_contact_term(whole(made), moving(state, common_m_s), moving(state, own_m_s))
    assert term.scale == CONTACT_SCALE
    return term.weight.mean((1, 2))


def test_feet_that_stand_in_both_are_held_in_full(made: Made) -> None:
    found = weight(made, speeds(0.0, 0.0, 0.0), speeds(0.0, 0.0, 0.0))
    torch.testing.assert_close(found, torch.full_like(found, FULL))


def test_feet_that_swing_in_the_common_motion_are_let_go(made: Made) -> None:
    found = weight(made, speeds(0.0, 0.05, 1.0), speeds(0.0, 0.0, 0.0)) / FULL
    torch.testing.assert_close(found[1], found.new_tensor(0.25))  # the speed that counts a quarter
    assert float(found[2]) < 1e-4


def test_a_video_whose_own_feet_swing_objects_for_itself_alone(made: Made) -> None:
    found = weight(made, speeds(0.0, 0.0, 0.0), speeds(0.0, 2.0, 0.0)) / FULL
    assert float(found[1]) < 1e-3
    torch.testing.assert_close(found[[0, 2]], torch.ones(2, dtype=torch.float64))


@pytest.mark.long
def test_a_fit_goes_on_from_the_one_before_to_the_same_place(made: Made) -> None:
    all_, true = whole(made), in_own_axes(made)
    spread = DeviationSpread(np.full((3, 20, 25), 0.03), OFFSETS)
    given = (made.state, made.cameras(), spread, replace(OPTIONS, max_steps=12))
    cold, cost = fit_deviations(all_, true, *given)
    again, lower = fit_deviations(all_, cold, *given, restart=False)
    assert lower <= cost
    assert mpjpe_mm(made.body, again, cold) < 1.0
    astray = disturbed(cold, 0.03)
    back, _ = fit_deviations(all_, astray, *given, restart=False)
    assert mpjpe_mm(made.body, astray, cold) > 10.0
    assert mpjpe_mm(made.body, back, cold) < 2.0


def test_frames_that_one_video_shows_alone_go_on_from_the_others(made: Made) -> None:
    """An elbow that one video has otherwise in all frames takes no step where the others end."""
    unmatched, elbow = 5, 18
    scene, state = whole(made, unmatched), in_own_axes(made)
    edge = state.R_local.shape[1] - unmatched
    turned, bent = state.R_local.clone(), exp(torch.tensor([0.0, 0.7, 0.0])).to(state.R_local)
    turned[0, :, elbow] = bent @ turned[0, :, elbow]
    given = replace(state, R_local=turned), made.cameras()
    common = consensus_motion(scene, *given).R_local[0]
    targets = targets_of(scene, state, replace(made.state, R_local=common[None]), made.cameras())
    videos = at_video_frames(scene, state, made.state, targets).R_local
    for motion, source in ((common, turned[0]), *zip(videos, state.R_local, strict=True)):
        steps = [x[edge - 1, elbow].mT @ x[edge, elbow] for x in (motion, source)]
        torch.testing.assert_close(*steps, rtol=0, atol=1e-6)
    apart = geodesic_angle(common[:, elbow], turned[0, :, elbow])
    assert apart[edge:].min() > 0.3
    assert apart[edge:].std() < 0.01


def test_the_nearest_true_flag() -> None:
    flags = torch.tensor([[0, 1, 0, 0, 1, 0], [0] * 6, [1] * 6], dtype=torch.bool)
    nearest = [[1, 1, 1, 4, 4, 4], [0] * 6, [0, 1, 2, 3, 4, 5]]
    assert nearest_true(flags).tolist() == nearest


def test_frames_that_a_fit_turned_away_from_the_keypoints_are_lost(made: Made) -> None:
    all_, state = whole(made), in_own_axes(made)
    R_local = state.R_local.clone()
    half = torch.diag(torch.tensor([-1.0, -1.0, 1.0])).to(R_local)  # head down
    R_local[1, :8, 0] = half @ R_local[1, :8, 0]
    lost = frames_lost(all_, replace(state, R_local=R_local), state)
    assert lost[1, :5].all()
    assert not lost[1, 12:].any()
    assert not lost[[0, 2]].any()


def test_a_chain_deviates_no_further_than_its_keypoints_may(made: Made) -> None:
    """With rotations coupled one by one a hand deviates twice as far as its keypoint may; with
    positions coupled, too, no further."""
    all_, state = whole(made), in_own_axes(made)
    spread_m = 0.03
    spread = DeviationSpread(np.full((3, 20, 25), spread_m), OFFSETS)
    options = replace(OPTIONS, correlation_s=0.0)
    faces = torch.ones_like(state.trans[..., 0])
    targets = targets_of(all_, state, made.state, made.cameras())
    terms = deviation_terms(all_, state, made.state, targets, spread, options, faces)
    wrist = made.body.keypoints.names.index("left_wrist")
    hip = made.body.keypoints.names.index("mid_hip")
    derivatives = made.body.derivatives(made.body.keypoints, state).d_pose
    jacobian = (derivatives[0, 5, wrist] - derivatives[0, 5, hip])[:, 3:]  # the root's turn apart
    deviates = []
    for some in (terms[:-1], terms):
        pull = linearise(some, state).diagonal[0, 5, 3:72, 3:72]
        covariance = jacobian @ torch.linalg.solve(pull, jacobian.T)
        deviates.append(float(covariance.diagonal().mean().sqrt()))
    assert deviates[0] > 1.5 * spread_m
    assert 0.5 * spread_m < deviates[1] < spread_m


def test_positions_of_limbs_are_coupled_however_the_body_is_turned(made: Made) -> None:
    state, trust = in_own_axes(made), torch.ones(3, 20, dtype=torch.float64)
    trust[:, 15:] = 0.0
    names = made.body.keypoints.names
    targets = CouplingTargets(state.R_local, state.trans, trust)
    term = position_coupling(made.body, targets, state, trust.new_full((3, 20, len(names)), 900.0))
    coupled = {name for name, weight in zip(names, term.weight[0, 0], strict=True) if weight > 0}
    assert coupled == COUPLED
    assert float(term.weight[:, 15:].max()) == 0.0
    two_layouts = Body.of(made.body.model, "body25", "coco17")
    count = len(two_layouts.keypoints.names)
    both = position_coupling(two_layouts, targets, state, trust.new_full((3, 20, count), 900.0))
    torch.testing.assert_close(both.weight.sum(), term.weight.sum())
    R_local = state.R_local.clone()
    R_local[:, :, 0] = exp(torch.tensor([0.4, -0.3, 0.2]).double()) @ R_local[:, :, 0]
    turned = replace(state, R_local=R_local, trans=state.trans + 1.0)
    assert float(term.cost(turned).max()) < 1e-12
    bent = disturbed(state, 0.1)
    assert float(term.cost(bent).min()) > 1.0


def test_a_keypoints_spread_is_half_its_own() -> None:
    alike = np.full((2, 3, 4), 0.05)
    np.testing.assert_allclose(pooled_spread_m(alike), alike)
    one = np.zeros((1, 1, 4))
    one[..., 0] = 0.08
    np.testing.assert_allclose(pooled_spread_m(one)[0, 0], [np.sqrt(0.004), *[np.sqrt(0.0008)] * 3])
    np.testing.assert_allclose(pooled_spread_m(0 * one), LEAST_SPREAD_M[0])
    once = np.zeros((1, 30, 4))
    once[0, 0] = 0.24
    np.testing.assert_allclose(pooled_spread_m(once)[0, 1:], once.mean())
    np.testing.assert_allclose(pooled_spread_m(10 * once)[0, 1:], LEAST_SPREAD_M[1])


def test_medians_leave_out_what_is_not_known() -> None:
    rng = np.random.default_rng(0)
    values = np.where(rng.random((7, 4, 9)) < 0.4, np.nan, rng.random((7, 4, 9)))
    values[..., 0] = 0.5
    np.testing.assert_array_equal(finite_median(values), np.nanmedian(values, axis=-1))


VIDEO = 1  # the one that turns, or whose fit went wrong


def turned(state: MotionState, angle_rad: float, since: int = 0) -> MotionState:
    """One video's root orientation turned about the body's vertical from a frame on."""
    R_local = state.R_local.clone()
    turn = exp(torch.tensor([0.0, angle_rad, 0.0]).double())
    R_local[VIDEO, since:, 0] = R_local[VIDEO, since:, 0] @ turn
    return replace(state, R_local=R_local)


def filming(scene: Scene, state: MotionState) -> Scene:
    """The same scene whose keypoints are those of other motions, in their cameras' axes."""
    return replace(scene, observations=filmed(scene, state))


def weights(scene: Scene, made: Made, state: MotionState) -> Tensor:
    targets = targets_of(scene, state, made.state, made.cameras())
    return facing_agreement(scene, state, targets)


def test_who_turns_away_for_a_while_is_released_for_that_while(made: Made) -> None:
    performed = turned(in_own_axes(made), 1.5, since=8)
    alike = weights(filming(whole(made), performed), made, performed)
    torch.testing.assert_close(alike[[0, 2]], torch.ones(2, FRAMES, dtype=torch.float64))
    assert float(alike[VIDEO, :4].min()) > 0.99
    assert float(alike[VIDEO, 14:].max()) < 0.25


@pytest.mark.parametrize("angle_rad", [1.5, np.pi])
def test_a_wrong_root_orientation_that_the_keypoints_refute_is_not_released(made, angle_rad):
    wrong = turned(in_own_axes(made), angle_rad)
    alike = weights(whole(made), made, wrong)
    torch.testing.assert_close(alike, torch.ones_like(alike))


@pytest.mark.parametrize("restart", [False, True])
def test_deviations_from_a_reversed_fit_end_like_those_from_a_good_one(made, restart):
    true = in_own_axes(made)
    spread = DeviationSpread(np.full((3, FRAMES, 25), 0.03), OFFSETS)
    given = (made.state, made.cameras(), spread, replace(OPTIONS, max_steps=12))
    good, wrong = (
        fit_deviations(whole(made), state, *given, restart=restart)[0]
        for state in (true, turned(true, np.pi))
    )
    assert mpjpe_mm(made.body, wrong, good) < 2.0
