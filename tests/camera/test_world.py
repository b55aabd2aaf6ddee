"""World and ground alignment: parameters and joints stay one body, and its feet are at height 0."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from imocap_core.camera.world import (
    BodyMotion,
    Extrinsics,
    GroundAlignment,
    align_camera_to_ground,
    align_motion_to_ground,
    find_ground_alignment,
    to_world,
)

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
    body, aligned_camera = (
        align_motion_to_ground(world, ground),
        align_camera_to_ground(camera, ground),
    )
    np.testing.assert_allclose(
        body.joints, world.joints @ ground.R_upright_from_world.T + ground.t, atol=1e-12
    )
    np.testing.assert_allclose(
        body.joints @ aligned_camera.R.T + aligned_camera.t, motion.joints, atol=1e-12
    )


def walk(rng: np.random.Generator, width_m: float) -> tuple[Array, Array]:
    """Feet that stand and swing in turn along x, y up; the pelvis leans forward by 15 degrees."""
    step = np.arange(120)
    feet = np.zeros((120, 2, 3))
    for foot in range(2):
        swings = (step // 10 % 2) == foot
        feet[:, foot, 0] = np.cumsum(np.where(swings, 0.05, 0.0))
        feet[:, foot, 1] = np.where(swings, 0.15, 0.0)
        feet[:, foot, 2] = width_m * (foot - 0.5)
    pelvis = feet.mean(axis=1) + [0.25, 0.93, 0.0]
    pelvis[:, 1] = 0.93
    return feet + rng.normal(scale=0.005, size=feet.shape), pelvis


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("seed", range(3))
def test_a_tilted_ground_is_found(up: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    feet, pelvis = walk(rng, width_m=0.3)
    tilt = Rotation.random(random_state=seed)
    shift = rng.normal(size=3)
    ground = find_ground_alignment(
        [tilt.apply(feet.reshape(-1, 3)).reshape(feet.shape) + shift],
        [tilt.apply(pelvis) + shift],
        up,
    )
    axis = {"y": 1, "z": 2}[up]
    upright = ground.R_upright_from_world @ tilt.apply([0.0, 1.0, 0.0])
    assert np.degrees(np.arccos(upright[axis])) < 3.0
    stand = tilt.apply(feet[:, 0]) + shift
    heights = (stand @ ground.R_upright_from_world.T + ground.t)[:, axis]
    assert abs(np.quantile(heights, 0.3)) < 0.03
    np.testing.assert_allclose(np.linalg.det(ground.R_upright_from_world), 1.0)


def test_feet_on_one_spot_leave_it_to_the_posture() -> None:
    feet = np.zeros((30, 2, 3)) + np.random.default_rng(0).normal(scale=0.003, size=(30, 2, 3))
    ground = find_ground_alignment([feet], [np.tile([0.0, 0.9, 0.0], (30, 1))], "y")
    assert np.degrees(np.arccos(ground.R_upright_from_world[1, 1])) < 3.0


def test_missing_frames_are_left_out() -> None:
    feet, pelvis = walk(np.random.default_rng(0), width_m=0.3)
    feet[::7] = np.nan
    assert np.isfinite(find_ground_alignment([feet], [pelvis], "z").R_upright_from_world).all()
    with pytest.raises(ValueError, match="no foot in two consecutive frames"):
        find_ground_alignment([np.full((4, 2, 3), np.nan)], [pelvis[:4]], "z")
    with pytest.raises(ValueError, match="expected y or z, got 'x'"):
        find_ground_alignment([feet], [pelvis], "x")
