"""A lens's distortion is OpenCV's, has an inverse everywhere, and belongs to its focal length."""

import cv2
import numpy as np
import pytest

from imocap_core.camera.projection import Lens, intrinsics, project_camera

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
