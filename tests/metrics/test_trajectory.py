"""Root paths and feet in contact with the ground, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.metrics.trajectory import (
    foot_contacts,
    foot_sliding_mm_s,
    planted_foot_speed_mm_s,
    root_path_aligned_error_mm,
    root_path_error_mm,
)


@pytest.fixture
def path() -> np.ndarray:
    return np.cumsum(np.random.default_rng(1).normal(scale=0.1, size=(50, 3)), axis=0)


def test_path_error_by_hand() -> None:
    # True path 0, 1 m; predicted 0, 2 m: with centroids together each end is 0.5 m off.
    true, predicted = np.zeros((2, 3)), np.zeros((2, 3))
    true[1, 2], predicted[1, 2] = 1, 2
    assert root_path_error_mm(predicted + 7, true) == pytest.approx(500)


def test_path_error_forgives_an_offset_only(path: np.ndarray) -> None:
    R = Rotation.from_euler("y", 20, degrees=True).as_matrix()
    assert root_path_error_mm(path + np.array([1, 2, 3]), path) == pytest.approx(0, abs=1e-9)
    assert root_path_error_mm(1.5 * path, path) > 50
    assert root_path_error_mm(path @ R.T, path) > 50
    assert root_path_aligned_error_mm(1.5 * path @ R.T - 4, path) == pytest.approx(0, abs=1e-9)


def test_missing_frames_are_left_out(path: np.ndarray) -> None:
    holed = path + 1
    holed[5:9] = np.nan
    assert root_path_error_mm(holed, path) == pytest.approx(0, abs=1e-9)
    assert np.isnan(root_path_error_mm(path * np.nan, path))
    assert np.isnan(root_path_aligned_error_mm(path * np.nan, path))


def test_sliding_by_hand() -> None:
    # The left foot stands all along and is predicted to creep 2 mm a frame at 25 frames a second;
    # the right foot strides through the air.
    true = np.zeros((10, 2, 3))
    true[:, 1, 0] = 0.1 * np.arange(10)
    predicted = true.copy()
    predicted[:, 0, 2] += 0.002 * np.arange(10)
    contact = foot_contacts(true, fps=25)
    np.testing.assert_array_equal(contact, np.tile([True, False], (10, 1)))
    assert foot_sliding_mm_s(predicted, contact, 25) == pytest.approx(50)
    assert foot_sliding_mm_s(true, contact, 25) == pytest.approx(0)
    assert np.isnan(foot_sliding_mm_s(true, np.zeros((10, 2), bool), 25))


def test_planted_speed_is_the_median_over_frames_in_contact() -> None:
    feet = np.zeros((6, 1, 3))
    feet[:, 0, 0] = np.cumsum([0, 0.001, 0.002, 0.003, 0.5, 0.5])  # the last two steps swing
    contact = np.array([True, True, True, True, False, False])[:, None]
    assert planted_foot_speed_mm_s(feet, contact, 10) == pytest.approx(20)
    assert np.isnan(planted_foot_speed_mm_s(feet, ~np.ones((6, 1), bool), 10))


def test_the_foot_s_own_motion_does_not_count_as_sliding() -> None:
    true = np.zeros((6, 1, 3))
    true[:, 0, 0] = 0.003 * np.arange(6)  # rolls slowly, still in contact
    contact = foot_contacts(true, fps=30)
    assert contact.all()
    assert foot_sliding_mm_s(true, contact, 30) == pytest.approx(90)
    assert foot_sliding_mm_s(true, contact, 30, true_feet_m=true) == pytest.approx(0)


def test_contact_of_a_missing_foot_is_unknown() -> None:
    true = np.zeros((5, 1, 3))
    true[2] = np.nan
    np.testing.assert_array_equal(foot_contacts(true, 30)[:, 0], [True, False, False, False, True])


@pytest.mark.usefixtures("unchecked_shapes")
def test_misuse_is_named(path: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"\(T, 3\)"):
        root_path_error_mm(path, path[1:])
    with pytest.raises(ValueError, match="contact must be"):
        foot_sliding_mm_s(np.zeros((5, 2, 3)), np.ones((5, 1), bool), 30)
