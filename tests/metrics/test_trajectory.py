"""Root paths and feet in contact with the ground, by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.metrics import trajectory


@pytest.fixture
def path() -> np.ndarray:
    return np.cumsum(np.random.default_rng(1).normal(scale=0.1, size=(50, 3)), axis=0)


def test_path_error_by_hand():
    # True path 0, 1 m; predicted 0, 2 m: with centroids together each end is 0.5 m off.
    true, predicted = np.zeros((2, 3)), np.zeros((2, 3))
    true[1, 2], predicted[1, 2] = 1, 2
    assert trajectory.root_path_error_mm(predicted + 7, true) == pytest.approx(500)


def test_path_error_forgives_an_offset_only(path: np.ndarray) -> None:
    R = Rotation.from_euler("y", 20, degrees=True).as_matrix()
    assert trajectory.root_path_error_mm(path + np.array([1, 2, 3]), path) == pytest.approx(
        0, abs=1e-9
    )
    assert trajectory.root_path_error_mm(1.5 * path, path) > 50
    assert trajectory.root_path_error_mm(path @ R.T, path) > 50
    assert trajectory.root_path_aligned_error_mm(1.5 * path @ R.T - 4, path) == pytest.approx(
        0, abs=1e-9
    )


def test_missing_frames_are_left_out(path: np.ndarray) -> None:
    holed = path + 1
    holed[5:9] = np.nan
    assert trajectory.root_path_error_mm(holed, path) == pytest.approx(0, abs=1e-9)
    assert np.isnan(trajectory.root_path_error_mm(path * np.nan, path))
    assert np.isnan(trajectory.root_path_aligned_error_mm(path * np.nan, path))


def test_sliding_by_hand():
    # The left foot stands all along and is predicted to creep 2 mm a frame at 25 frames a second;
    # the right foot strides through the air.
    true = np.zeros((10, 2, 3))
    true[:, 1, 0] = 0.1 * np.arange(10)
    predicted = true.copy()
    predicted[:, 0, 2] += 0.002 * np.arange(10)
    contact = trajectory.foot_contacts(true, fps=25)
    np.testing.assert_array_equal(contact, np.tile([True, False], (10, 1)))
    assert trajectory.foot_sliding_mm_s(predicted, contact, 25) == pytest.approx(50)
    assert trajectory.foot_sliding_mm_s(true, contact, 25) == pytest.approx(0)
    assert np.isnan(trajectory.foot_sliding_mm_s(true, np.zeros((10, 2), bool), 25))


def test_planted_speed_is_the_median_over_frames_in_contact() -> None:
    feet = np.zeros((6, 1, 3))
    feet[:, 0, 0] = np.cumsum([0, 0.001, 0.002, 0.003, 0.5, 0.5])  # the last two steps swing
    contact = np.array([True, True, True, True, False, False])[:, None]
    assert trajectory.planted_foot_speed_mm_s(feet, contact, 10) == pytest.approx(20)
    assert np.isnan(trajectory.planted_foot_speed_mm_s(feet, ~np.ones((6, 1), bool), 10))


def test_the_foot_s_own_motion_does_not_count_as_sliding() -> None:
    true = np.zeros((6, 1, 3))
    true[:, 0, 0] = 0.003 * np.arange(6)  # rolls slowly, still in contact
    contact = trajectory.foot_contacts(true, fps=30)
    assert contact.all()
    assert trajectory.foot_sliding_mm_s(true, contact, 30) == pytest.approx(90)
    assert trajectory.foot_sliding_mm_s(true, contact, 30, true_feet_m=true) == pytest.approx(0)


def test_contact_of_a_missing_foot_is_unknown() -> None:
    true = np.zeros((5, 1, 3))
    true[2] = np.nan
    np.testing.assert_array_equal(
        trajectory.foot_contacts(true, 30)[:, 0], [True, False, False, False, True]
    )


@pytest.mark.usefixtures("unchecked_shapes")
def test_misuse_is_named(path: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"\(T, 3\)"):
        trajectory.root_path_error_mm(path, path[1:])
    with pytest.raises(ValueError, match="contact must be"):
        trajectory.foot_sliding_mm_s(np.zeros((5, 2, 3)), np.ones((5, 1), bool), 30)


def _turn(axis: str, degrees: float) -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def test_angle_by_hand() -> None:
    np.testing.assert_allclose(
        trajectory.rotation_angle_deg(np.stack([np.eye(3), _turn("x", 30), _turn("z", -170)])),
        [0, 30, 170],
    )


def test_camera_error_by_hand():
    # Truth: the camera looks 90 degrees from the reference; recovered: 83 about the same axis.
    error = trajectory.camera_rotation_error_deg(
        _turn("y", 83), np.eye(3), _turn("y", 90), np.eye(3)
    )
    assert error == pytest.approx(7)


def test_camera_error_does_not_see_the_choice_of_either_world() -> None:
    rng = np.random.default_rng(0)
    cameras = Rotation.random(4, rng=rng).as_matrix()
    recovered = cameras @ _turn("x", 4)
    world_a, world_b = Rotation.random(2, rng=rng).as_matrix()
    error = trajectory.camera_rotation_error_deg(cameras[1], cameras[0], recovered[1], cameras[0])
    moved = trajectory.camera_rotation_error_deg(
        cameras[1] @ world_a, cameras[0] @ world_a, recovered[1] @ world_b, cameras[0] @ world_b
    )
    assert moved == pytest.approx(error)
    reference_world = cameras @ cameras[0].T  # recovered world = the reference camera's axes
    np.testing.assert_allclose(
        trajectory.camera_rotation_error_deg(
            reference_world, reference_world[0], cameras, cameras[0]
        ),
        0,
        atol=1e-5,
    )


K = np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]])


def test_reprojection_by_hand():
    # (1, 0, 2) lands on (100, 40); seen 3 right and 4 below.
    points = np.array([[[1.0, 0, 2], [0, 0, 5]]])
    detected = np.array([[[103.0, 44], [50, 50]]])
    errors = trajectory.reprojection_errors_px(points, K, detected, np.array([[1.0, 0.25]]))
    np.testing.assert_allclose(errors, [[5, 10]])
    assert trajectory.reprojection_error_px(errors, np.array([[1.0, 0.25]])) == pytest.approx(6)


def test_undetected_and_behind_do_not_count() -> None:
    points = np.array([[[0.0, 0, 1], [0, 0, -1], [0, 0, 1]]])
    detected = np.array([[[50.0, 41], [50, 40], [np.nan, np.nan]]])
    confidence = np.array([[1.0, 1.0, 0.0]])
    errors = trajectory.reprojection_errors_px(points, K, detected, confidence)
    np.testing.assert_array_equal(np.isnan(errors), [[False, True, True]])
    assert trajectory.reprojection_error_px(errors, confidence) == pytest.approx(1)
    assert np.isnan(trajectory.reprojection_error_px(errors * np.nan, confidence))


@pytest.mark.usefixtures("unchecked_shapes")
def test_misuse_of_cameras_is_named() -> None:
    with pytest.raises(ValueError, match="must share"):
        trajectory.reprojection_errors_px(
            np.zeros((2, 3, 3)), K, np.zeros((2, 4, 2)), np.ones((2, 3))
        )


def test_places_are_compared_up_to_a_similarity() -> None:
    true = np.array([[0.0, 0, 0], [4, 0, 0], [0, 3, 0], [0, 0, 2]])
    moved = 0.7 * true @ _turn("z", 40).T + [1.0, 2.0, 3.0]
    np.testing.assert_allclose(trajectory.camera_place_errors_mm(moved, true), 0, atol=1e-9)
    moved[1] += [0.1, 0, 0]
    errors = trajectory.camera_place_errors_mm(moved, true)
    assert 40 < errors[1] < 150


def test_a_focal_length_too_long_is_as_wrong_as_one_too_short() -> None:
    assert trajectory.focal_error_pct(600, 600) == 0
    assert trajectory.focal_error_pct(1.1 * 600, 600) == pytest.approx(
        trajectory.focal_error_pct(600 / 1.1, 600)
    )
    assert trajectory.focal_error_pct(606, 600) == pytest.approx(1, abs=0.01)


R = Rotation.from_euler("xyz", [20, -50, 110], degrees=True).as_matrix()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(4)


@pytest.fixture
def joints(rng: np.random.Generator) -> np.ndarray:
    path = np.cumsum(rng.normal(scale=0.01, size=(150, 1, 3)), axis=0)
    return path + rng.normal(scale=0.3, size=(1, 7, 3)) + rng.normal(scale=0.02, size=(150, 7, 3))


def _moved(x: np.ndarray, scale: float = 1.0) -> np.ndarray:
    return scale * x @ R.T + [3.0, -1.0, 2.0]


def test_both_forgive_one_similarity_of_a_segment(joints, rng):
    predicted = joints + rng.normal(scale=0.02, size=joints.shape)
    parts = [_moved(predicted[: trajectory.SEGMENT], 1.6), predicted[trajectory.SEGMENT :] - 4]
    moved = np.concatenate(parts)
    for metric in (trajectory.w_mpjpe_mm, trajectory.wa_mpjpe_mm):
        assert metric(moved, joints) == pytest.approx(metric(predicted, joints))
        assert metric(_moved(joints, 0.5), joints) == pytest.approx(0, abs=1e-9)
    assert 5 < trajectory.wa_mpjpe_mm(predicted, joints) < trajectory.w_mpjpe_mm(predicted, joints)


def test_w_mpjpe_counts_all_that_moves_after_two_frames():
    # The first two frames agree; afterwards the prediction is 60 mm off: 98 of 100 frames.
    true = np.tile(np.random.default_rng(1).normal(size=(1, 5, 3)), (trajectory.SEGMENT, 1, 1))
    predicted = true.copy()
    predicted[2:] += [0.0, 0.06, 0.0]
    assert trajectory.w_mpjpe_mm(predicted, true) == pytest.approx(60 * 0.98)
    assert trajectory.wa_mpjpe_mm(predicted, true) < 5


def test_each_segment_is_aligned_anew() -> None:
    true = np.tile(np.random.default_rng(1).normal(size=(1, 5, 3)), (2 * trajectory.SEGMENT, 1, 1))
    predicted = true.copy()
    predicted[trajectory.SEGMENT :] += 1.0
    assert trajectory.w_mpjpe_mm(predicted, true) == pytest.approx(0, abs=1e-9)
    predicted[trajectory.SEGMENT :] -= 1.0
    predicted[trajectory.SEGMENT - 1 :] += 1.0  # the jump is inside the first segment now
    assert trajectory.wa_mpjpe_mm(predicted, true) > 5


def test_rte_by_hand():
    # A path of 4 m out and back; the prediction turns round 0.6 m beside the end. Rigid alignment
    # of three points in a line cannot mend the length: mean error over the path's length.
    true = np.array([[0.0, 0, 0], [2, 0, 0], [0, 0, 0]])
    predicted = np.array([[0.0, 0, 0], [2.6, 0, 0], [0, 0, 0]])
    # centroids 0.6667 and 0.8667: errors 0.2, 0.4, 0.2
    assert trajectory.rte_pct(predicted, true) == pytest.approx(100 * (0.8 / 3) / 4)


def test_rte_forgives_a_rigid_motion_not_scale(joints: np.ndarray) -> None:
    path = joints[:, 0]
    assert trajectory.rte_pct(_moved(path), path) == pytest.approx(0, abs=1e-9)
    assert trajectory.rte_pct(_moved(path, 1.3), path) > 0.1
    assert np.isnan(trajectory.rte_pct(path, np.zeros_like(path)))


def test_jitter_by_hand():
    # x = t^3 has the jerk 6 m/s^3; third differences of a cubic are exact.
    seconds = np.arange(8) / 25
    joints = np.zeros((8, 1, 3))
    joints[:, 0, 1] = seconds**3
    assert trajectory.jitter_10m_s3(joints, np.arange(8), 25.0) == pytest.approx(0.6)


def test_jitter_forgives_acceleration_and_gaps(joints: np.ndarray) -> None:
    frames = np.arange(len(joints))
    falling = joints + 0.01 * frames[:, None, None] ** 2
    error = trajectory.jitter_10m_s3(joints, frames, 30.0)
    assert trajectory.jitter_10m_s3(_moved(falling), frames, 30.0) == pytest.approx(error)
    assert np.isnan(trajectory.jitter_10m_s3(joints, 2 * frames, 30.0))
    jump = np.zeros((8, 1, 3))
    jump[4:] += 1.0
    gap = np.array([0, 1, 2, 3, 10, 11, 12, 13])
    assert trajectory.jitter_10m_s3(jump, gap, 30.0) == 0


def test_foot_sliding_by_hand():
    # One point stands and is predicted to creep 3 mm a frame; the other strides 50 mm a frame.
    true = np.zeros((10, 2, 3))
    true[:, 1, 0] = 0.05 * np.arange(10)
    predicted = true.copy()
    predicted[:, 0, 2] += 0.003 * np.arange(10)
    frames = np.arange(10)
    assert trajectory.foot_sliding_mm(predicted, true, frames, 30.0) == pytest.approx(3.0)
    assert trajectory.foot_sliding_mm(_moved(predicted), true, frames, 30.0) == pytest.approx(3.0)
    # at 60 frames a second the same displacement a frame is twice as fast
    assert trajectory.foot_sliding_mm(predicted, true, frames, 60.0) == pytest.approx(6.0)
    assert np.isnan(trajectory.foot_sliding_mm(predicted[:, 1:], true[:, 1:], frames, 30.0))
    assert np.isnan(trajectory.foot_sliding_mm(predicted, true, 2 * frames, 30.0))
