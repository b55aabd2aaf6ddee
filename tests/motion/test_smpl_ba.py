"""SMPL-BA on made scenes: cameras, focal lengths and motion come back, differences are kept."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from imocap_core.camera.averaging import angle_deg
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.motion_posterior import motion_posterior
from imocap_core.motion.multiview.common_motion import misfit, unknowns_of
from imocap_core.motion.multiview.modes import lasting_m, spread_beyond_noise_m
from imocap_core.motion.multiview.per_video import joint_spread_rad
from imocap_core.motion.multiview.scene import (
    JointMotion,
    Scene,
    agreement,
    cameras_from_motion,
    mean_shapes,
    starts_by_video,
    to_world,
)
from imocap_core.motion.multiview.smpl_ba import common_then_deviations, solve_jointly
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.posterior_noise import Noise
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.params import MotionParams, UncertaintyParams
from imocap_core.rotations import exp
from tests.motion.made import FOCAL_PX, FRAMES, WEIGHTS, Made, filmed, mpjpe_mm, scene, wide_prior

OPTIONS = MotionParams(
    objective="shared", rank=1, rounds=2, coupling_rad=0.1, coupling_path_m=0.3,
    correlation_s=0.25, max_steps=10,
)  # fmt: skip

OTHERS = [pytest.param(objective, marks=pytest.mark.long) for objective in ("paper", "single")]


def in_own_axes(made: Made) -> MotionState:
    """The true motion of every video in its own camera's axes."""
    R, t = torch.as_tensor(made.R), torch.as_tensor(made.t)
    R_local = made.state.R_local.repeat(len(R), 1, 1, 1, 1)
    R_local[:, :, 0] = R[:, None] @ R_local[:, :, 0]
    rest = made.body.model.joints_template[0]
    pelvis = torch.einsum("mij,tj->mti", R, made.state.trans[0] + rest) + t[:, None]
    valid = made.state.valid.repeat(len(R), 1)
    return MotionState.of(R_local, pelvis - rest, made.state.betas.repeat(len(R), 1), valid)


def whole(made: Made, unmatched: int = 0) -> Scene:
    """A scene whose correspondences are frame to frame; the last frames may have none."""
    maps = [np.arange(float(FRAMES)) for _ in made.observations]
    for m in maps[1:]:
        m[FRAMES - unmatched :] = np.nan
    trust = [np.isfinite(m).astype(float) for m in maps]
    timeline = make_timeline(maps, trust, FRAMES)
    return Scene(made.body, wide_prior(), made.observations, timeline, trust, 0, WEIGHTS)


def disturbed(state: MotionState, spread: float) -> MotionState:
    """Smooth, different errors in every video, as monocular fits have them."""
    generator = torch.Generator().manual_seed(1)
    size = (len(state.trans), 1, FRAME_UNKNOWNS)
    shift = spread * torch.randn(size, generator=generator, dtype=torch.float64)
    shift = shift.expand(-1, FRAMES, -1)
    return state.retract(shift, torch.zeros_like(state.betas))


@pytest.fixture(scope="module")
def solved(made: Made) -> Callable[[str], JointMotion]:
    """The scene solved from a disturbed start, by the objective."""
    start = disturbed(in_own_axes(made), 0.12)
    return cache(lambda which: solve_jointly(whole(made), start, replace(OPTIONS, objective=which)))


def test_cameras_of_equal_motions_are_exact(made: Made) -> None:
    scene, truth = whole(made), in_own_axes(made)
    cameras = cameras_from_motion(scene, truth, scene.K)
    assert float(np.max(angle_deg(cameras.R.numpy(), made.R))) < 1e-4
    np.testing.assert_allclose(cameras.t.numpy(), made.t, atol=1e-6)
    world = to_world(scene.aligned(truth), cameras)
    assert torch.allclose(world.root[1], world.root[0], atol=1e-6)


@pytest.mark.parametrize("objective", ["shared", *OTHERS])
def test_the_views_together_beat_the_start(made, solved, objective):
    truth = in_own_axes(made)
    start, found = disturbed(truth, 0.12), solved(objective)
    before, after = (mpjpe_mm(made.body, s, truth) for s in (start, found.state))
    assert 0.1 < after < 0.5 * before
    assert float(np.max(angle_deg(found.cameras.R.numpy(), made.R))) < 5.0
    assert torch.equal(found.cameras.R[0], torch.eye(3, dtype=torch.float64))


@pytest.mark.parametrize("objective", ["shared", OTHERS[1]])
def test_a_round_goes_on_where_the_one_before_stopped(made, solved, objective):
    truth, scene, first = in_own_axes(made), whole(made), solved(objective)
    options = replace(OPTIONS, objective=objective)
    said: list[str] = []
    again = solve_jointly(scene, first.state, options, said.append, cameras=first.cameras)
    assert not any("10x" in what or "3x" in what for what in said)
    assert again.misfit <= 1.1 * first.misfit
    assert mpjpe_mm(made.body, again.state, truth) <= 1.05 * mpjpe_mm(made.body, first.state, truth)
    assert float(np.max(angle_deg(again.cameras.R.numpy(), first.cameras.R.numpy()))) < 1.0


@pytest.mark.long
def test_a_round_afresh_passes_all_robust_scales(made, solved):
    truth, scene, first = in_own_axes(made), whole(made), solved("shared")
    given, said = (scene, first.state, OPTIONS), list[str]()
    again = solve_jointly(*given, said.append, cameras=first.cameras, restart=True)
    assert [what for what in said if "10x" in what or "3x" in what]
    assert mpjpe_mm(made.body, again.state, truth) <= 1.05 * mpjpe_mm(made.body, first.state, truth)


def test_a_misfit_weighs_keypoints_by_trust_and_is_not_lower_for_less_of_it(made: Made) -> None:
    """A video that is off makes the misfit large; trusted little, it counts little; and where all
    are trusted alike, it does not matter how much."""
    given = whole(made)
    off = torch.tensor([[0.0], [0.2], [0.0]], dtype=torch.float64).expand(3, 3)
    wrong = replace(made.cameras(), t=made.cameras().t + off)

    def of(*trust: float) -> float:
        confidence = np.repeat(np.array(trust, dtype=float)[:, None], FRAMES, axis=1)
        timeline = replace(given.timeline, confidence=confidence)
        return misfit(replace(given, timeline=timeline), made.state, wrong)

    assert of(1, 1, 1) > 0.1
    assert of(0.02, 0.02, 0.02) == pytest.approx(of(1, 1, 1), rel=1e-9)
    one = misfit(given, made.state, made.cameras())
    assert of(1, 0.02, 1) == pytest.approx(one, abs=0.04 * of(1, 1, 1))
    assert of(1, 0.0, 1) == pytest.approx(one, abs=1e-3 * of(1, 1, 1))


@pytest.mark.long
def test_a_limb_that_starts_on_the_wrong_side_in_all_videos_is_put_right() -> None:
    """Opposite views agree with an arm in front of the body and behind it; the others do not."""
    made = scene(FRAMES, [0.0, 90.0, 180.0, -90.0], np.random.default_rng(5))
    truth, wrist = in_own_axes(made), SMPL_JOINTS.index("right_wrist")
    wrong = truth.R_local.clone()
    swing = exp(torch.tensor([0.0, 2.2, 0.0], dtype=torch.float64))
    wrong[:, :, SMPL_JOINTS.index("right_shoulder")] = swing
    start = replace(truth, R_local=wrong)
    cameras = made.cameras()
    found = common_then_deviations(whole(made), start, cameras, OPTIONS, cameras_known=True)
    start_mm, found_mm, true_mm = (
        1000 * made.body.positions(made.body.joints, s)[:, :, wrist]
        for s in (start, found.state, truth)
    )
    assert float((start_mm - true_mm).norm(dim=-1).min()) > 200
    assert float((found_mm - true_mm).norm(dim=-1).quantile(0.9)) < 50


def test_a_start_for_each_video_whose_arms_or_legs_are_elsewhere(made: Made) -> None:
    own, elbow = in_own_axes(made), SMPL_JOINTS.index("left_elbow")
    scene, given = whole(made, unmatched=5), (made.state, ("shoulder", "elbow"))
    assert starts_by_video(scene.aligned(own), *given) == []
    bent = own.R_local.clone()
    bent[1, :, elbow] = exp(torch.tensor([0.0, 1.6, 0.0], dtype=torch.float64))
    _, second = starts_by_video(scene.aligned(replace(own, R_local=bent)), *given)
    changed = (second.R_local != made.state.R_local).flatten(3).any(-1)[0]
    assert changed[:, elbow].tolist() == [True] * (FRAMES - 5) + [False] * 5
    assert torch.equal(second.R_local[0, : FRAMES - 5, elbow], bent[1, : FRAMES - 5, elbow])


@pytest.mark.long
def test_a_round_from_cameras_that_are_wrong_finds_them(made, solved):
    scene, first = whole(made), solved("shared")
    turn = exp(torch.tensor([0.0, 0.1, 0.0], dtype=torch.float64))
    wrong = replace(first.cameras, R=torch.cat([first.cameras.R[:1], turn @ first.cameras.R[1:]]))
    again = solve_jointly(scene, first.state, OPTIONS, cameras=wrong)
    off = angle_deg(again.cameras.R.numpy(), made.R)
    assert float(np.max(off)) < 0.5 * float(np.degrees(0.1))


@pytest.mark.long
def test_unmatched_frames_get_a_pose_too(made: Made) -> None:
    truth = in_own_axes(made)
    start, options = disturbed(truth, 0.12), replace(OPTIONS, max_steps=2)
    found = solve_jointly(whole(made, unmatched=5), start, options).state
    assert bool(torch.isfinite(found.R_local).all())
    assert mpjpe_mm(made.body, found, truth) < mpjpe_mm(made.body, start, truth)


def test_one_video_keeps_its_monocular_motion(made: Made) -> None:
    alone = in_own_axes(made).rows(torch.tensor([0]))
    one = whole(replace(made, observations=made.observations[:1]))
    found = solve_jointly(one, alone, OPTIONS)
    assert found.state is alone
    assert "one video" in found.status


def test_a_video_that_goes_its_own_way_loses_its_say() -> None:
    generator = torch.Generator().manual_seed(2)
    R = exp(0.3 * torch.randn(1, 30, 24, 3, generator=generator, dtype=torch.float64))
    R = R.expand(4, -1, -1, -1, -1).clone()
    R[3, :, 18] = R[3, :, 18] @ exp(torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64))
    follows = agreement(R, torch.ones(4, 30).double())
    assert float(follows[3, :, 18].max()) < 0.05
    assert float(follows[3, :, :18].min()) > 0.99
    assert float(follows[0, :, 18].min()) > 5 * float(follows[3, :, 18].max())


def test_spread_is_read_from_the_excess_over_detector_noise() -> None:
    rng = np.random.default_rng(0)
    sigma, spread_m, depth, focal = 2.0, 0.05, 4.0, 600.0
    px = np.hypot(sigma, spread_m * focal / depth)
    errors = rng.normal(0, px, (4, 400, 25, 2))
    errors[:, :, 3] = np.nan
    views = np.full((4, 400), sigma), np.full((4, 400), depth), np.full(4, focal)
    found, quiet = (spread_beyond_noise_m(e, *views, window=60) for e in (errors, errors / 20))
    assert np.median(found) == pytest.approx(spread_m * np.sqrt(4 / 3), rel=0.1)
    assert np.nanmax(quiet) == 0.0


def test_what_lasts_is_told_from_what_passes_and_from_what_all_keypoints_share() -> None:
    passing = 30 * np.sin(np.arange(100.0) * 2 * np.pi / 50)
    errors = np.tile(passing[None, :, None, None], (2, 1, 9, 2)) + 3.0  # pixels
    errors[1, :, 4] += 27.0  # an arm that is held elsewhere throughout
    errors[:, :, 8] = np.nan
    expected = 0.02 * 99**0.5 * (np.arange(18).reshape(2, 1, 9) == 13)
    found = lasting_m(errors, np.full((2, 100), 4.0), np.full(2, 600.0))
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_arms_held_elsewhere_throughout_tilt_no_camera() -> None:
    """Of two views 20 degrees apart: a camera 24 degrees off would explain the arms as well."""
    made = scene(FRAMES, [0.0, 20.0], np.random.default_rng(0))
    truth = in_own_axes(made)
    for name, turn in (("left_shoulder", 1.2), ("right_shoulder", -1.2)):
        truth.R_local[1, :, SMPL_JOINTS.index(name)] @= exp(torch.tensor([0.0, 0.0, turn]).double())
    videos = filmed(made, truth, np.random.default_rng(3))
    given = whole(replace(made, observations=videos)), disturbed(truth, 0.05)
    found = solve_jointly(*given, replace(OPTIONS, max_steps=4))
    assert float(np.max(angle_deg(found.cameras.R.numpy(), made.R))) < 4.0


def test_a_still_performance_is_coupled_tightly(made: Made) -> None:
    still = joint_spread_rad(made.body, made.state, np.zeros((3, FRAMES, 25)))
    loose = joint_spread_rad(made.body, made.state, np.full((3, FRAMES, 25), 0.1))
    assert (still <= loose).all()
    assert (loose[:, :, 18] > still[:, :, 18]).all()


PERFORMERS = [0, 1, 0, 1]
LIMBS = [(1, 4), (4, 7), (16, 18), (18, 20)]  # thigh, shank, upper arm, forearm


@pytest.fixture(scope="module")
def two_performers() -> Made:
    """Four views, two of either performer, whose bodies differ."""
    rng = np.random.default_rng(7)
    two_performers = scene(FRAMES, [0.0, 80.0, -70.0, 170.0], rng)
    shapes = torch.as_tensor(0.7 * rng.standard_normal((2, 10)))
    own = in_own_axes(two_performers)
    rest = two_performers.body.model.joints_template[0]
    betas = shapes[PERFORMERS]
    moved = own.trans + rest - two_performers.body.model.shape(betas).joints_rest[:, 0, None]
    state = replace(own, betas=betas, trans=moved)
    videos = filmed(two_performers, state, rng)
    videos = [replace(o, performer=p) for o, p in zip(videos, PERFORMERS, strict=True)]
    return replace(two_performers, state=state, observations=videos)


def proportions(two_performers: Made, betas: torch.Tensor) -> np.ndarray:
    """Logarithms of the limbs' lengths, relative to each other (M, 4)."""
    rest = two_performers.body.model.shape(betas).joints_rest
    lengths = torch.stack([(rest[:, b] - rest[:, a]).norm(dim=-1) for a, b in LIMBS], dim=-1)
    return np.asarray((lengths.log() - lengths.log().mean(dim=1, keepdim=True)).numpy())


def start_of(two_performers: Made) -> MotionState:
    return disturbed(replace(two_performers.state, betas=torch.zeros(4, 10).double()), 0.05)


@pytest.fixture(scope="module")
def declared(two_performers: Made) -> JointMotion:
    return solve_jointly(whole(two_performers), start_of(two_performers), OPTIONS)


@pytest.mark.long
def test_each_performer_has_one_shape_of_their_own(two_performers, declared):
    betas = declared.state.betas
    assert torch.equal(betas[0], betas[2])
    assert torch.equal(betas[1], betas[3])
    difference, true = (
        np.diff(proportions(two_performers, b[:2]), axis=0)[0]
        for b in (betas, two_performers.state.betas)
    )
    assert np.abs(difference - true).mean() < 0.3 * np.abs(true).mean()


@pytest.mark.long
def test_declared_performers_are_recovered_better_than_one_body(two_performers, declared):
    alike = [replace(o, performer=0) for o in two_performers.observations]
    one = replace(two_performers, observations=alike)
    undeclared = solve_jointly(whole(one), start_of(one), OPTIONS)
    assert torch.equal(undeclared.state.betas[0], undeclared.state.betas[1])
    errors = [
        mpjpe_mm(two_performers.body, m.state, two_performers.state) for m in (declared, undeclared)
    ]
    assert errors[0] < 0.8 * errors[1]


@pytest.mark.long
def test_the_order_of_performers_does_not_count(two_performers, declared):
    others = [replace(o, performer=1 - o.performer) for o in two_performers.observations]
    given = whole(replace(two_performers, observations=others)), start_of(two_performers)
    turned = solve_jointly(*given, OPTIONS)
    assert mpjpe_mm(two_performers.body, turned.state, declared.state) < 3.0


@pytest.mark.long
def test_every_performer_s_uncertainty_is_finite(two_performers, declared):
    noise = Noise(UncertaintyParams())
    posterior = motion_posterior(whole(two_performers), declared, OPTIONS, noise)
    assert all(np.isfinite(covariance).all() for covariance in posterior.covariances_m2)


def test_mean_shapes_are_those_of_each_performer(two_performers: Made) -> None:
    state = replace(two_performers.state, betas=torch.arange(40.0).reshape(4, 10).double())
    means = mean_shapes(state, PERFORMERS)
    torch.testing.assert_close(means[0], state.betas[[0, 2]].mean(0))
    torch.testing.assert_close(means[1], state.betas[[1, 3]].mean(0))


TURNS_DEG = [0.0, 75.0, -80.0, 170.0]
OFF = np.array([1.12, 0.9, 1.0, 0.86])  # of the true focal lengths
SPREAD = 0.15


@pytest.fixture(scope="module")
def four_views() -> Made:
    return scene(FRAMES, TURNS_DEG, np.random.default_rng(8), path_m=0.4)


def assumed(four_views: Made, spread: float) -> Scene:
    """Wrong focal lengths with a prior of this spread."""
    seen = [
        replace(o, K=o.K @ np.diag([off, off, 1.0]), focal_spread=spread)
        for o, off in zip(four_views.observations, OFF, strict=True)
    ]
    return whole(replace(four_views, observations=seen))


def start_at_wrong_focals(four_views: Made) -> MotionState:
    """The true motions in their own axes, each as far away as its focal length makes it look."""
    true = in_own_axes(four_views)
    far = torch.as_tensor(np.stack([np.ones(4), np.ones(4), OFF], axis=-1))
    rest = four_views.body.model.joints_template[0]
    state = replace(true, trans=(true.trans + rest) * far[:, None] - rest)
    return disturbed(state, 0.02)


def recovered(four_views: Made, spread: float, max_steps: int) -> JointMotion:
    options: MotionParams = replace(OPTIONS, max_steps=max_steps)
    return solve_jointly(assumed(four_views, spread), start_at_wrong_focals(four_views), options)


def focal_errors(found: JointMotion) -> np.ndarray:
    return np.log(found.cameras.K[:, 0, 0].numpy() / FOCAL_PX)


@pytest.mark.long
def test_focal_lengths_come_back_and_the_middle_of_the_picture_stays(four_views: Made) -> None:
    found = recovered(four_views, 0.5, 12)
    before = np.log(OFF)
    errors = focal_errors(found)
    assert np.sqrt((errors**2).mean()) < 0.3 * np.sqrt((before**2).mean()), errors
    assert torch.equal(found.cameras.K[:, 0, 0], found.cameras.K[:, 1, 1])
    middle = np.stack([o.K[:, 2] for o in four_views.observations])
    np.testing.assert_array_equal(found.cameras.K[:, :, 2].numpy(), middle)


@pytest.mark.long
def test_known_focal_lengths_stay(four_views: Made) -> None:
    np.testing.assert_allclose(focal_errors(recovered(four_views, 0.0, 2)), np.log(OFF), atol=1e-12)


def test_the_focal_likelihood_counts_once_per_action(four_views: Made) -> None:
    all_ = assumed(four_views, SPREAD)
    some = replace(
        all_,
        observations=[
            replace(o, focal_spread=SPREAD if v in (1, 3) else 0.0)
            for v, o in enumerate(all_.observations)
        ],
    )
    free = unknowns_of(some, [])
    assert list(free.videos) == [1, 3]
    assert free.weight.tolist() == pytest.approx([FRAMES / SPREAD**2] * 2)


def test_the_prior_is_about_the_assumed_value_wherever_the_fit_is(four_views: Made) -> None:
    free = unknowns_of(assumed(four_views, SPREAD), [])
    state = replace(four_views.state, log_focal=torch.log(torch.as_tensor(OFF))[None])
    (prior,) = free.prior(four_views.cameras().K)
    assert float(prior.cost(state)) == pytest.approx(0.0, abs=1e-12)
    (elsewhere,) = free.prior(free.intrinsics(four_views.cameras().K, state.log_focal[0]))
    moved = replace(state, log_focal=state.log_focal + 0.1)
    still = replace(state, log_focal=torch.zeros_like(state.log_focal))
    assert float(elsewhere.cost(still)) == pytest.approx(0.0, abs=1e-12)
    assert float(prior.cost(moved)) == pytest.approx(FRAMES / SPREAD**2 * 4 * 0.1**2)
