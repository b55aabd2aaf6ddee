"""The ground is under planted feet; the level world is one world, whichever axis points up."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.camera import gravity
from imocap_core.camera.ground_plane import Ground
from tests.camera import standing


@pytest.mark.parametrize("seed", range(3))
def test_the_ground_is_under_the_planted_feet(seed: int) -> None:
    rotation = Rotation.random(random_state=seed)
    ground = gravity.estimate_ground(
        [standing.filmed(standing.walking(), rotation)], standing.PRIOR
    )
    floor = rotation.apply(standing.walking()[:, 0] * (1.0, 0.0, 1.0))
    assert np.abs(ground.height_m(floor)).max() < 0.12  # of a way of 3 m, tilted by up to 3 degrees
    assert abs(ground.height_m(floor).mean()) < 0.02
    np.testing.assert_allclose(ground.height_m(ground.origin), 0.0, atol=1e-12)
    beside = rotation.inv().apply(ground.origin) - standing.walking()[:, 0].mean(axis=0)
    assert np.linalg.norm(beside[[0, 2]]) < 0.06
    assert 5 < ground.height_sd_mm < 40


@pytest.mark.parametrize("posture", ["push-up", "lying", "kneeling", "handstand"])
def test_the_ground_is_under_the_parts_that_carry(posture: str) -> None:
    joints = standing.turned(
        standing.posed(standing.POSTURES[posture]), Rotation.from_euler("y", 90, degrees=True)
    )
    ground = gravity.estimate_ground(
        [gravity.FilmedBody(joints, standing.FPS, standing.LEVEL_CAMERA)], standing.PRIOR
    )
    assert abs(ground.height_m(joints[0, 0]) - joints[0, 0, 1]) < 0.15  # the length of a hand


def test_soles_below_the_ground_are_measured() -> None:
    joints = standing.walking()
    ground = Ground(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.05, 0.0]), 1.0, 10.0)
    np.testing.assert_allclose(gravity.sole_depths_mm(joints, ground), 50.0, atol=2.0)
    np.testing.assert_array_equal(gravity.sole_depths_mm(joints + (0, 0.1, 0), ground), 0.0)


def test_without_a_body_the_height_is_unknown() -> None:
    nobody = gravity.FilmedBody(np.full((4, 24, 3), np.nan), standing.FPS, standing.LEVEL_CAMERA)
    ground = gravity.estimate_ground([nobody], standing.PRIOR)
    assert np.isnan(ground.height_sd_mm)
    assert standing.angle_deg(ground.up, np.array([0.0, 1.0, 0.0])) < 10


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
