"""Camera and reprojection errors, by hand and by what they must not depend on."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.metrics.trajectory import (
    camera_place_errors_mm,
    camera_rotation_error_deg,
    focal_error_pct,
    reprojection_error_px,
    reprojection_errors_px,
    rotation_angle_deg,
)


def _turn(axis: str, degrees: float) -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def test_angle_by_hand() -> None:
    np.testing.assert_allclose(
        rotation_angle_deg(np.stack([np.eye(3), _turn("x", 30), _turn("z", -170)])), [0, 30, 170]
    )


def test_camera_error_by_hand() -> None:
    # Truth: the camera looks 90 degrees from the reference; recovered: 83 about the same axis.
    error = camera_rotation_error_deg(_turn("y", 83), np.eye(3), _turn("y", 90), np.eye(3))
    assert error == pytest.approx(7)


def test_camera_error_does_not_see_the_choice_of_either_world() -> None:
    rng = np.random.default_rng(0)
    cameras = Rotation.random(4, rng=rng).as_matrix()
    recovered = cameras @ _turn("x", 4)
    world_a, world_b = Rotation.random(2, rng=rng).as_matrix()
    error = camera_rotation_error_deg(cameras[1], cameras[0], recovered[1], cameras[0])
    moved = camera_rotation_error_deg(
        cameras[1] @ world_a, cameras[0] @ world_a, recovered[1] @ world_b, cameras[0] @ world_b
    )
    assert moved == pytest.approx(error)
    reference_world = cameras @ cameras[0].T  # recovered world = the reference camera's axes
    np.testing.assert_allclose(
        camera_rotation_error_deg(reference_world, reference_world[0], cameras, cameras[0]),
        0,
        atol=1e-5,
    )


K = np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]])


def test_reprojection_by_hand() -> None:
    # (1, 0, 2) lands on (100, 40); seen 3 right and 4 below.
    points = np.array([[[1.0, 0, 2], [0, 0, 5]]])
    detected = np.array([[[103.0, 44], [50, 50]]])
    errors = reprojection_errors_px(points, K, detected, np.array([[1.0, 0.25]]))
    np.testing.assert_allclose(errors, [[5, 10]])
    assert reprojection_error_px(errors, np.array([[1.0, 0.25]])) == pytest.approx(6)


def test_undetected_and_behind_do_not_count() -> None:
    points = np.array([[[0.0, 0, 1], [0, 0, -1], [0, 0, 1]]])
    detected = np.array([[[50.0, 41], [50, 40], [np.nan, np.nan]]])
    confidence = np.array([[1.0, 1.0, 0.0]])
    errors = reprojection_errors_px(points, K, detected, confidence)
    np.testing.assert_array_equal(np.isnan(errors), [[False, True, True]])
    assert reprojection_error_px(errors, confidence) == pytest.approx(1)
    assert np.isnan(reprojection_error_px(errors * np.nan, confidence))


@pytest.mark.usefixtures("unchecked_shapes")
def test_misuse_is_named() -> None:
    with pytest.raises(ValueError, match="must share"):
        reprojection_errors_px(np.zeros((2, 3, 3)), K, np.zeros((2, 4, 2)), np.ones((2, 3)))


def test_places_are_compared_up_to_a_similarity() -> None:
    true = np.array([[0.0, 0, 0], [4, 0, 0], [0, 3, 0], [0, 0, 2]])
    moved = 0.7 * true @ _turn("z", 40).T + [1.0, 2.0, 3.0]
    np.testing.assert_allclose(camera_place_errors_mm(moved, true), 0, atol=1e-9)
    moved[1] += [0.1, 0, 0]
    errors = camera_place_errors_mm(moved, true)
    assert 40 < errors[1] < 150


def test_a_focal_length_too_long_is_as_wrong_as_one_too_short() -> None:
    assert focal_error_pct(600, 600) == 0
    assert focal_error_pct(1.1 * 600, 600) == pytest.approx(focal_error_pct(600 / 1.1, 600))
    assert focal_error_pct(606, 600) == pytest.approx(1, abs=0.01)
