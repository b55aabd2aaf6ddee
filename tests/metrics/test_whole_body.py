"""Joints that are not aligned on, and vertices: by head, and the claimed invariances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.metrics.position import joint_errors_mm, mean_over_frames
from imocap_core.metrics.whole_body import aligned_joint_errors_mm, pa_pve_mm, vertex_distances_mm

ANCHORS = [0, 1, 2, 3]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(8)


@pytest.fixture
def joints(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(scale=0.4, size=(5, 6, 3))


def _moved(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Another similarity transform in each frame."""
    R = Rotation.random(len(points), rng=rng).as_matrix()
    return 1.7 * np.einsum("tab,tjb->tja", R, points) + rng.normal(size=(len(points), 1, 3))


def test_a_joint_that_is_no_anchor_has_its_whole_error(joints: np.ndarray) -> None:
    predicted = joints.copy()
    predicted[:, 5] += [0.03, 0.0, 0.04]
    errors = aligned_joint_errors_mm(predicted, joints, ANCHORS)
    np.testing.assert_allclose(errors, [0, 0, 0, 0, 0, 50], atol=1e-9)


def test_alignment_forgives_a_similarity_of_each_frame(
    joints: np.ndarray, rng: np.random.Generator
) -> None:
    predicted = joints + rng.normal(scale=0.05, size=joints.shape)
    errors = aligned_joint_errors_mm(predicted, joints, ANCHORS)
    again = aligned_joint_errors_mm(_moved(predicted, rng), joints, ANCHORS)
    np.testing.assert_allclose(again, errors)
    assert errors.min() > 5


def test_a_missing_joint_is_nan(joints: np.ndarray) -> None:
    true = joints.copy()
    true[:, 4] = np.nan
    errors = aligned_joint_errors_mm(joints, true, ANCHORS)
    np.testing.assert_array_equal(np.isnan(errors), [False] * 4 + [True, False])


def test_pve_by_hand() -> None:
    # Vertices off by 30 and 50 mm once the root, 1 m away, is taken off.
    true = np.zeros((1, 2, 3))
    predicted = np.array([[[0.03, 0, 1], [0, 0.03, 1.04]]])
    root = np.array([[0.0, 0, 1]])
    assert _pve_mm(predicted, true, root, np.zeros((1, 3))) == pytest.approx(40.0)


def test_pve_forgives_a_translation_only(joints: np.ndarray, rng: np.random.Generator) -> None:
    predicted = joints + rng.normal(scale=0.05, size=joints.shape)
    error = _pve_mm(predicted, joints, predicted[:, 0], joints[:, 0])
    shifted = predicted + rng.normal(size=(len(joints), 1, 3))
    assert _pve_mm(shifted, joints, shifted[:, 0], joints[:, 0]) == pytest.approx(error)
    assert _pve_mm(1.5 * predicted, joints, 1.5 * predicted[:, 0], joints[:, 0]) > error + 20


def test_pa_pve_forgives_a_similarity(joints: np.ndarray, rng: np.random.Generator) -> None:
    predicted = joints + rng.normal(scale=0.05, size=joints.shape)
    assert pa_pve_mm(_moved(predicted, rng), joints) == pytest.approx(pa_pve_mm(predicted, joints))
    assert pa_pve_mm(_moved(joints, rng), joints) == pytest.approx(0, abs=1e-9)
    assert pa_pve_mm(joints * [-1, 1, 1], joints) > 50


def test_vertex_distances_are_joint_errors_about_the_roots(
    joints: np.ndarray, rng: np.random.Generator
) -> None:
    predicted = joints + rng.normal(scale=0.05, size=joints.shape)
    roots = predicted[:, 0], joints[:, 0]
    expected = joint_errors_mm(predicted - roots[0][:, None], joints - roots[1][:, None])
    np.testing.assert_allclose(vertex_distances_mm(predicted, joints, *roots), expected)


def _pve_mm(*surfaces_and_roots: np.ndarray) -> float:
    return mean_over_frames(vertex_distances_mm(*surfaces_and_roots))
