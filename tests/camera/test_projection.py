"""Laws of the pinhole camera."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.camera.projection import (
    Lens,
    camera_from_world,
    intrinsics,
    normalised,
    project,
    project_camera,
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


SIZE = (1280, 720)
K = intrinsics(1000.0, SIZE)
LENSES = [
    [-0.25],
    [0.3],
    [-0.3, 0.1],
    [-0.25, 0.08, 0.001, -0.002],
    [-0.25, 0.08, 0.001, -0.002, -0.01],
]


def pixels(seed=0, beyond=50):
    rng = np.random.default_rng(seed)
    return rng.uniform((-beyond, -beyond), np.array(SIZE) + beyond, (200, 2))


@pytest.mark.parametrize("coefficients", LENSES)
def test_distorts_as_opencv_does(coefficients):
    lens = Lens.of(coefficients, K)
    points = np.random.default_rng(1).uniform((-0.5, -0.4, 1), (0.5, 0.4, 1), (100, 3))
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, lens.coefficients)
    np.testing.assert_allclose(lens.distorted(project_camera(points, K)), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("coefficients", LENSES)
def test_undistorting_is_the_inverse_inside_the_picture_and_beyond(coefficients):
    lens = Lens.of(coefficients, K)
    for beyond in (50, 2000):
        shown = pixels(beyond=beyond)
        np.testing.assert_allclose(lens.distorted(lens.undistorted(shown)), shown, atol=1e-6)


def test_missing_points_stay_missing_and_the_middle_stays():
    shown = np.array([[np.nan, np.nan], K[:2, 2]])
    for move in (Lens.of([-0.25], K).undistorted, Lens.of([-0.25], K).distorted):
        moved = move(shown)
        assert np.isnan(moved[0]).all()
        np.testing.assert_allclose(moved[1], K[:2, 2], atol=1e-12)


def test_the_reach_is_where_the_polynomial_turns_back():
    lens = Lens.of([-0.25], K)
    assert lens.reach == pytest.approx((1 / 0.75) ** 0.5)
    assert lens.reach_px == pytest.approx(1000 * lens.reach * (1 - 0.25 * lens.reach**2))
    assert Lens.of([0.1], K).reach_px == np.inf


def test_the_same_lens_relative_to_another_focal_length_and_in_smaller_pictures():
    lens, shown = Lens.of([-0.25, 0.08, 0.001, -0.002, -0.01], K), pixels()
    other = lens.relative_to(intrinsics(1300.0, SIZE))
    np.testing.assert_allclose(other.undistorted(shown), lens.undistorted(shown), atol=1e-7)
    smaller = lens.rescaled(0.5).undistorted((shown + 0.5) * 0.5 - 0.5)
    np.testing.assert_allclose((smaller + 0.5) / 0.5 - 0.5, lens.undistorted(shown), atol=1e-7)


def test_bent_points_are_seen_by_a_pinhole_where_the_lens_shows_them():
    lens = Lens.of([-0.2], K)
    points = np.random.default_rng(2).uniform((-1, -0.5, 2), (1, 0.5, 4), (50, 3))
    move = np.array([[0.5, 0.0, 30.0], [0.0, 0.5, -10.0], [0.0, 0.0, 1.0]])
    bent = lens.bent(points, K)
    np.testing.assert_allclose(bent[:, 2], points[:, 2], atol=1e-9)
    expected = lens.distorted(project_camera(points, K))
    np.testing.assert_allclose(project_camera(bent, K), expected, atol=1e-9)
    turned = Lens.of([-0.2], K).bent(points, move @ K)  # of a warped picture
    np.testing.assert_allclose(
        project_camera(turned, move @ K),
        lens.distorted(project_camera(points, move @ K)),
        atol=1e-9,
    )
    behind = np.array([[0.1, 0.2, -1.0]])
    np.testing.assert_array_equal(lens.bent(behind, K), behind)
