"""World and ground alignment: parameters and joints stay one body, and its feet are at height 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from imocap_core.camera.gravity import (
    BodyMotion,
    Extrinsics,
    GroundAlignment,
    align_camera_to_ground,
    align_motion_to_ground,
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
