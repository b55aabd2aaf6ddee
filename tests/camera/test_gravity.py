"""Up is where bodies balance, feet are planted on a plane, and cameras are held level; the ground
is under planted feet, and the level world is one world."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from imocap_core.body.kinematics import JOINT_MASS_SHARES, centre_of_mass
from imocap_core.camera import gravity
from imocap_core.camera.gravity import (
    BALL_ABOVE_SOLE_M,
    HEEL_RADIUS_M,
    BodyMotion,
    Extrinsics,
    FilmedBody,
    GroundAlignment,
    align_camera_to_ground,
    align_motion_to_ground,
    estimate_ground,
    estimate_up,
    gravity_cost,
    to_world,
)
from imocap_core.camera.ground_plane import Ground
from imocap_core.camera.tilt_evidence import (
    ANKLES,
    BALANCE_DOF,
    BALLS,
    DYNAMIC_S,
    LEAN_ACROSS,
    LEAN_AHEAD,
    SWAY_M,
    UNSEEN_M,
    WRISTS,
    Support,
    balance_costs,
    camera_angles_deg,
    perpendicular,
    support_of,
    support_shares,
)
from tests.camera.standing import (
    FPS,
    LEVEL_CAMERA,
    POSTURES,
    PRIOR,
    SITTING,
    angle_deg,
    filmed,
    posed,
    standing,
    turned,
    walking,
)

LONG = pytest.mark.long
Y_UP = np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize("joints", [standing(), walking()], ids=["standing", "walking"])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=LONG) for seed in (1, 2))])
def test_up_turns_with_the_world(joints, seed: int) -> None:
    rotation = Rotation.random(random_state=seed)
    estimate = estimate_up([filmed(joints, rotation)], PRIOR)
    assert angle_deg(estimate.up, rotation.apply(Y_UP)) < 3.0
    assert 0.5 < estimate.sd_deg < 5.0


def test_cameras_without_a_body_tell_it_by_how_they_are_held() -> None:
    nobody = np.full((10, 24, 3), np.nan)
    alone = estimate_up([FilmedBody(nobody, FPS, LEVEL_CAMERA)], PRIOR)
    pitch = Rotation.from_euler("x", PRIOR.pitch_down_deg, degrees=True)
    assert angle_deg(alone.up, pitch.apply(Y_UP)) < 1.0
    together = estimate_up([FilmedBody(nobody, FPS, LEVEL_CAMERA)] * 4, PRIOR)
    assert together.sd_deg < 0.7 * alone.sd_deg
    assert estimate_up([filmed(standing(), Rotation.identity())], PRIOR).sd_deg < alone.sd_deg


@pytest.mark.parametrize("pitch_deg", [-10.0, 0.0, 20.0])
def test_a_body_shows_the_pitch_of_its_camera(pitch_deg: float) -> None:
    camera = Rotation.from_euler("x", pitch_deg, degrees=True).as_matrix() @ LEVEL_CAMERA
    estimate = estimate_up([filmed(walking(), Rotation.identity(), camera)], PRIOR)
    assert angle_deg(estimate.up, Y_UP) < 4.0


@pytest.mark.parametrize("lean_deg", [-40, 40])
def test_a_motion_that_leans_to_or_from_the_camera_is_wrong_rather_than_its_camera(lean_deg):
    leaning = turned(standing(), Rotation.from_euler("x", lean_deg, degrees=True))
    estimate = estimate_up([FilmedBody(leaning, FPS, LEVEL_CAMERA)], PRIOR)
    assert angle_deg(estimate.up, Y_UP) < 15.0


@pytest.mark.parametrize("posture", POSTURES)
@pytest.mark.parametrize(
    ("facing_deg", "down_deg", "roll_deg"), [(90, 5, 0), pytest.param(30, 12, 4, marks=LONG)]
)
def test_who_lies_kneels_hangs_or_stands_on_the_hands_is_level(
    posture, facing_deg, down_deg, roll_deg
):
    turn = Rotation.from_euler("y", facing_deg, degrees=True)
    joints = turned(posed(POSTURES[posture], frames=75), turn)
    held = Rotation.from_euler("xz", (down_deg, roll_deg), degrees=True).as_matrix()
    estimate = estimate_up([FilmedBody(joints, FPS, held @ LEVEL_CAMERA)], PRIOR)
    assert angle_deg(estimate.up, Y_UP) < 12.0


@pytest.mark.parametrize("side_deg", [40, 90])
def test_who_sits_is_carried_by_the_seat_and_who_squats_by_the_feet(side_deg: int) -> None:
    joints = turned(posed(SITTING), Rotation.from_euler("y", side_deg, degrees=True))
    squat = joints + np.array([0.0, 0.3, 0.0]) * np.sin(np.arange(len(joints)) / 4)[:, None, None]
    for moving, least, most in ((joints, 0.5, 0.7), (squat, 0.0, 0.25)):
        seat = support_shares(Y_UP[None], support_of(moving, FPS, 20))[0][0, -2]
        assert least < np.median(seat) <= most
    estimate = estimate_up([FilmedBody(joints, FPS, LEVEL_CAMERA)], PRIOR)
    assert angle_deg(estimate.up, Y_UP) < 8.0


@pytest.mark.parametrize("roll_deg", [-25, 50])
def test_a_body_shows_the_roll_of_its_camera_unless_its_feet_are_unseen(roll_deg: int) -> None:
    camera = Rotation.from_euler("z", roll_deg, degrees=True).as_matrix() @ LEVEL_CAMERA
    joints, seen = standing(), np.zeros(standing().shape[:2])
    seen[:5] = 1.0
    ups = [estimate_up([FilmedBody(joints, FPS, camera, x)], PRIOR).up for x in (None, seen)]
    assert angle_deg(ups[0], Y_UP) < 5.0
    assert camera_angles_deg(ups[1][None], camera)[0] == pytest.approx(0.0, abs=5.0)


@pytest.mark.parametrize(("lean_deg", "least", "most"), [(-25, 8, 15), (25, 8, 15), (80, 0, 1)])
def test_a_trunk_that_leans_in_depth_tilts_the_camera_unless_it_lies_or_a_video_shows_feet(
    lean_deg: int, least: float, most: float
) -> None:
    leaning = turned(standing(), Rotation.from_euler("x", lean_deg, degrees=True))
    hidden = FilmedBody(leaning, FPS, LEVEL_CAMERA, np.zeros(leaning.shape[:2]))
    nobody = FilmedBody(np.full_like(leaning, np.nan), FPS, LEVEL_CAMERA)
    alone, level = (estimate_up([body], PRIOR).up for body in (hidden, nobody))
    assert least < angle_deg(alone, level) < most
    assert (alone - level) @ (leaning[0, 12] - leaning[0, 0]) > 0
    stands = filmed(standing(), Rotation.identity())
    both = [estimate_up([stands, body], PRIOR).up for body in (hidden, nobody)]
    assert angle_deg(*both) < 1e-6


@pytest.mark.parametrize("feet", [1, 2])
def test_a_foot_that_nobody_sees_carries_less_surely(feet: int) -> None:
    joints, seen = standing(), np.ones((len(standing()), 24))
    seen[:, ANKLES[:feet] + BALLS[:feet]] = 0.0
    ups = Rotation.from_euler("x", [[0.0], [15.0]], degrees=True).apply(Y_UP)
    given = [support_of(joints, FPS, 20, x) for x in (None, seen)]
    by_all, by_seen = (np.diff(balance_costs(ups, x, LEVEL_CAMERA[2])[0]) for x in given)
    assert 0 < by_seen < 0.9 * by_all


@pytest.mark.parametrize("rows", [WRISTS, WRISTS + ANKLES + BALLS], ids=["hands", "hands and feet"])
@pytest.mark.parametrize("toes_m", [0.0, 0.15])
def test_the_floor_is_under_toes_or_heels_and_not_under_a_hand_that_nobody_sees(rows, toes_m):
    joints, shown = standing().copy(), np.ones((len(standing()), 24))
    joints[:, WRISTS, 1] -= 2.0
    joints[:, BALLS, 1] += toes_m
    shown[:, rows] = 0.0
    toes = joints[:, BALLS, 1].min() - BALL_ABOVE_SOLE_M
    heels = joints[:, ANKLES, 1].min() - HEEL_RADIUS_M
    ground = estimate_ground([FilmedBody(joints, FPS, LEVEL_CAMERA, shown)], PRIOR)
    assert ground.origin[1] == pytest.approx(min(toes, heels), abs=0.02)


def test_an_up_on_which_the_witnesses_disagree_is_doubtful() -> None:
    """A push-up towards a level camera, or a man who stands below one that looks down steeply."""
    held = Rotation.from_euler("x", 5, degrees=True).as_matrix() @ LEVEL_CAMERA
    doubtful = estimate_up([FilmedBody(posed(POSTURES["push-up"]), FPS, held)], PRIOR)
    sure = estimate_up([FilmedBody(standing(), FPS, LEVEL_CAMERA)], PRIOR)
    assert doubtful.sd_deg > 10.0 > 2 * sure.sd_deg


def test_frames_without_all_joints_are_left_out() -> None:
    joints = standing().copy()
    joints[::3, 5] = np.nan
    assert np.isfinite(estimate_up([filmed(joints, Rotation.identity())], PRIOR).up).all()
    assert np.isfinite(estimate_up([filmed(joints[1:2], Rotation.identity())], PRIOR).up).all()


def test_the_centre_of_mass_is_the_hips_height_of_a_standing_body_and_moves_with_it() -> None:
    np.testing.assert_allclose(JOINT_MASS_SHARES.sum(), 1.0)
    joints = standing()[-1]
    centre = centre_of_mass(joints)
    assert 0.9 < centre[1] < 1.05
    assert abs(centre[0]) < 0.01
    turn, shift = Rotation.random(random_state=0), np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(
        centre_of_mass(turn.apply(joints) + shift), turn.apply(centre) + shift, atol=1e-12
    )


def test_the_cost_of_balance_is_that_of_the_whole_covariance() -> None:
    """The fast cost projects every limb; its slow twin projects their mean and covariance."""
    seen = np.random.default_rng(1).random((len(walking()), 24))
    support, sight = support_of(walking(), FPS, 20, seen), np.array([0.1, -0.2, 0.97])
    up = Rotation.random(7, random_state=3).apply(Y_UP)
    expected = [_slow_balance_cost(u, support, sight) for u in up]
    np.testing.assert_allclose(balance_costs(up, support, sight)[0], expected, rtol=1e-10)


def _slow_balance_cost(up, support: Support, sight) -> float:
    share = support_shares(up[None], support)[0][0]
    middles = np.einsum("sn,nsc->nc", share, support.limbs)
    apart = support.limbs - middles[:, None]
    spreads = 0.5 * np.einsum("sn,nsi,nsj->nij", share, apart, apart)
    unseen = np.einsum("sn,ns->n", share**2, support.limbs_unseen)[:, None, None] * np.eye(3)
    spreads += UNSEEN_M**2 * unseen
    axes = np.stack([axis[0] for axis in perpendicular(up[None])])
    costs = []
    moments = zip(support.centre, support.speed_m_s, middles, spreads, strict=True)
    for centre, speed_m_s, middle, spread in moments:
        height = up @ (centre - middle)
        free = SWAY_M**2 + (LEAN_ACROSS * height) ** 2 + (DYNAMIC_S * speed_m_s) ** 2
        covariance = axes @ spread @ axes.T + free * np.eye(2)
        covariance += (LEAN_AHEAD**2 - LEAN_ACROSS**2) * height**2 * np.outer(*2 * [axes @ sight])
        off = axes @ (centre - middle)
        squared = off @ np.linalg.solve(covariance, off)
        determinant = np.linalg.det(covariance) / SWAY_M**4
        costs.append((BALANCE_DOF + 2) * np.log1p(squared / BALANCE_DOF) + np.log(determinant))
    return float(np.mean(costs))


Array = NDArray[np.float64]
REST_PELVIS = np.array([0.01, -0.2, 0.03])


def simple_body(rng: np.random.Generator, frames: int = 7) -> BodyMotion:
    """A pelvis and one bone of half a metre along the pelvis' own y."""
    theta = rng.normal(size=(frames, 72))
    trans = rng.normal(size=(frames, 3))
    return BodyMotion(theta, trans, joints_of(theta, trans))


def joints_of(theta: Array, trans: Array) -> Array:
    pelvis = REST_PELVIS + trans
    bone = Rotation.from_rotvec(theta[:, :3]).apply([0.0, 0.5, 0.0])
    return np.stack([pelvis, pelvis + bone], axis=1)


def any_camera(rng: np.random.Generator) -> Extrinsics:
    return Extrinsics(Rotation.random(random_state=1).as_matrix(), rng.normal(size=3))


def test_parameters_and_joints_stay_one_body() -> None:
    rng = np.random.default_rng(0)
    camera = any_camera(rng)
    world = to_world(simple_body(rng), camera)
    np.testing.assert_allclose(joints_of(world.theta, world.trans), world.joints, atol=1e-12)


def test_a_body_that_turns_round_does_not_jump() -> None:
    turning = np.zeros((50, 72))
    turning[:, 1] = np.linspace(0.0, 3.0, 50)
    trans = np.zeros((50, 3))
    behind = Extrinsics(Rotation.from_rotvec([0.0, -1.0, 0.0]).as_matrix(), np.zeros(3))
    world = to_world(BodyMotion(turning, trans, joints_of(turning, trans)), behind)
    np.testing.assert_allclose(world.theta[:, 1], turning[:, 1] + 1.0, atol=1e-12)


def test_the_camera_sees_the_same_body() -> None:
    rng = np.random.default_rng(0)
    motion, camera = simple_body(rng), any_camera(rng)
    world = to_world(motion, camera)
    np.testing.assert_allclose(world.joints @ camera.R.T + camera.t, motion.joints, atol=1e-12)
    np.testing.assert_array_equal(world.theta[:, 3:], motion.theta[:, 3:])


def test_ground_alignment_changes_no_picture() -> None:
    rng = np.random.default_rng(0)
    motion, camera = simple_body(rng), any_camera(rng)
    world = to_world(motion, camera)
    ground = GroundAlignment(Rotation.random(random_state=2).as_matrix(), rng.normal(size=3))
    joints = align_motion_to_ground(world, ground).joints
    aligned = align_camera_to_ground(camera, ground)
    upright = world.joints @ ground.R_upright_from_world.T + ground.t
    np.testing.assert_allclose(joints, upright, atol=1e-12)
    np.testing.assert_allclose(joints @ aligned.R.T + aligned.t, motion.joints, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_ground_is_under_the_planted_feet(seed: int) -> None:
    rotation = Rotation.random(random_state=seed)
    ground = gravity.estimate_ground([filmed(walking(), rotation)], PRIOR)
    floor = rotation.apply(walking()[:, 0] * (1.0, 0.0, 1.0))
    assert np.abs(ground.height_m(floor)).max() < 0.12  # of a way of 3 m, tilted by up to 3 degrees
    assert abs(ground.height_m(floor).mean()) < 0.02
    np.testing.assert_allclose(ground.height_m(ground.origin), 0.0, atol=1e-12)
    beside = rotation.inv().apply(ground.origin) - walking()[:, 0].mean(axis=0)
    assert np.linalg.norm(beside[[0, 2]]) < 0.06
    assert 5 < ground.height_sd_mm < 40


@pytest.mark.parametrize("posture", ["push-up", "lying", "kneeling", "handstand"])
def test_the_ground_is_under_the_parts_that_carry(posture: str) -> None:
    joints = turned(posed(POSTURES[posture]), Rotation.from_euler("y", 90, degrees=True))
    ground = gravity.estimate_ground([gravity.FilmedBody(joints, FPS, LEVEL_CAMERA)], PRIOR)
    assert abs(ground.height_m(joints[0, 0]) - joints[0, 0, 1]) < 0.15  # the length of a hand


def test_soles_below_the_ground_are_measured() -> None:
    joints = walking()
    ground = Ground(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.05, 0.0]), 1.0, 10.0)
    np.testing.assert_allclose(gravity.sole_depths_mm(joints, ground), 50.0, atol=2.0)
    np.testing.assert_array_equal(gravity.sole_depths_mm(joints + (0, 0.1, 0), ground), 0.0)


def test_without_a_body_the_height_is_unknown() -> None:
    nobody = gravity.FilmedBody(np.full((4, 24, 3), np.nan), FPS, LEVEL_CAMERA)
    ground = gravity.estimate_ground([nobody], PRIOR)
    assert np.isnan(ground.height_sd_mm)
    assert angle_deg(ground.up, np.array([0.0, 1.0, 0.0])) < 10


def any_ground(seed: int) -> Ground:
    rng = np.random.default_rng(seed)
    up = rng.normal(size=3)
    return Ground(up / np.linalg.norm(up), rng.normal(size=3), 2.0, 15.0)


@pytest.mark.parametrize("seed", range(5))
def test_z_up_is_the_y_up_world_turned_by_a_quarter(seed: int) -> None:
    camera = Rotation.random(random_state=seed).as_matrix()
    y, z = (gravity.upright_alignment(any_ground(seed), camera, up) for up in "yz")
    np.testing.assert_allclose(
        z.R_upright_from_world, gravity.Z_UP_FROM_Y_UP @ y.R_upright_from_world, atol=1e-12
    )
    np.testing.assert_allclose(z.t, gravity.Z_UP_FROM_Y_UP @ y.t, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(y.R_upright_from_world), 1.0)


@pytest.mark.parametrize(("up", "ahead"), [("y", [0, 0, -1]), ("z", [0, 1, 0])])
def test_the_level_world_has_the_ground_at_0_and_the_camera_ahead(up: str, ahead: list) -> None:
    ground, camera = any_ground(1), Rotation.random(random_state=1).as_matrix()
    level = gravity.upright_alignment(ground, camera, up)
    moved = ground.moved(level.R_upright_from_world, level.t)
    axis = np.eye(3)["xyz".index(up)]
    np.testing.assert_allclose(moved.up, axis, atol=1e-12)
    np.testing.assert_allclose(moved.origin, 0, atol=1e-12)
    looks = level.R_upright_from_world @ camera[2]
    horizontal = looks - (looks @ axis) * axis
    np.testing.assert_allclose(horizontal / np.linalg.norm(horizontal), ahead, atol=1e-12)


def test_a_camera_that_looks_straight_down_or_up_has_its_picture_upright() -> None:
    ground = Ground(np.array([0.0, 1.0, 0.0]), np.zeros(3), 1.0, 10.0)
    down = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])  # the picture's top is along -z
    np.testing.assert_allclose(
        gravity.upright_alignment(ground, down, "y").R_upright_from_world, np.eye(3), atol=1e-12
    )
    looking_up = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    np.testing.assert_allclose(
        gravity.upright_alignment(ground, looking_up, "y").R_upright_from_world,
        np.eye(3),
        atol=1e-12,
    )


def test_another_axis_is_refused() -> None:
    with pytest.raises(ValueError, match="expected y or z, got 'x'"):
        gravity.upright_alignment(any_ground(0), np.eye(3), "x")


def test_gravity_allows_who_stands_or_lies_and_not_who_leans_as_a_whole() -> None:
    def cost(joints: NDArray[np.float64], lean_deg: float = 0.0) -> float:
        lean = Rotation.from_euler("x", lean_deg, degrees=True)
        return gravity_cost(FilmedBody(turned(joints, lean), FPS, LEVEL_CAMERA), PRIOR)

    for joints in (standing(), walking()):
        assert cost(joints) + 2.0 < min(cost(joints, -35.0), cost(joints, 35.0))
    lying = posed(POSTURES["push-up"], frames=75)
    assert cost(lying) + 2.0 < cost(lying, 35.0)
    assert cost(np.full((10, 24, 3), np.nan)) == 0.0
