"""Laws of the pinhole camera."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.camera.projection import (
    camera_from_world,
    intrinsics,
    normalised,
    project,
    rays,
    warp,
)

RNG = np.random.default_rng


def test_a_point_on_the_axis_lands_in_the_middle_of_the_picture():
    K = intrinsics(500.0, (641, 361))
    assert project(np.array([0.0, 0.0, 4.0]), K, np.eye(3), np.zeros(3)).tolist() == [320.0, 180.0]


def test_x_goes_right_and_y_goes_down():
    K = intrinsics(500.0, (641, 361))
    assert project(np.array([1.0, 0.0, 5.0]), K, np.eye(3), np.zeros(3)).tolist() == [420.0, 180.0]
    assert project(np.array([0.0, 1.0, 5.0]), K, np.eye(3), np.zeros(3)).tolist() == [320.0, 280.0]


def test_points_behind_the_camera_have_no_pixel():
    K = intrinsics(500.0, (640, 360))
    assert np.isnan(project(np.array([0.1, 0.2, -3.0]), K, np.eye(3), np.zeros(3))).all()


def test_a_ray_passes_through_the_point_it_came_from():
    rng = RNG(1)
    K = intrinsics(700.0, (640, 360))
    R = Rotation.random(rng=rng).as_matrix()
    t = np.array([0.2, -0.1, 6.0])
    x_world = rng.normal(size=(4, 7, 3))
    x_cam = camera_from_world(x_world, R, t)
    direction = rays(project(x_world, K, R, t), K)
    along = np.linalg.norm(x_cam, axis=-1, keepdims=True)
    assert np.allclose(direction * along, x_cam)
    assert np.allclose(normalised(project(x_world, K, R, t), K), x_cam[..., :2] / x_cam[..., 2:])


def test_a_turned_camera_warps_by_its_infinite_homography():
    rng = RNG(2)
    K = intrinsics(600.0, (640, 360))
    R_a = Rotation.from_euler("y", 4, degrees=True).as_matrix()
    R_b = Rotation.from_euler("yx", [9, -3], degrees=True).as_matrix()
    x_world = rng.normal(size=(50, 3)) + np.array([0, 0, 8])
    H_b_from_a = K @ R_b @ R_a.T @ np.linalg.inv(K)
    in_a, in_b = (project(x_world, K, R, np.zeros(3)) for R in (R_a, R_b))
    assert np.allclose(warp(H_b_from_a, in_a), in_b)


def test_missing_points_stay_missing():
    assert np.isnan(warp(np.eye(3), np.full((3, 2), np.nan))).all()


def test_a_focal_length_must_be_positive():
    with pytest.raises(ValueError, match="focal_px"):
        intrinsics(0.0, (640, 360))
