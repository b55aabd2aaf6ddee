"""Laws of robust means of rotations and vectors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.camera.averaging import angle_deg, mean_rotation, mean_vector, nearest_rotation


def noisy_rotations(rng, R, count, noise_deg):
    turns = Rotation.from_rotvec(np.deg2rad(noise_deg) * rng.normal(size=(count, 3)))
    return R @ turns.as_matrix()


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_one_rotation_is_its_own_mean(rng):
    R = Rotation.random(rng=rng).as_matrix()
    assert np.allclose(mean_rotation(R[None]), R)


def test_the_mean_turns_with_its_rotations(rng):
    R = noisy_rotations(rng, Rotation.random(rng=rng).as_matrix(), 40, 8.0)
    left, right = Rotation.random(2, rng=rng).as_matrix()
    moved = mean_rotation(left @ R @ right)
    assert angle_deg(moved, left @ mean_rotation(R) @ right) < 0.05


def test_a_third_of_flipped_rotations_does_not_move_the_mean(rng):
    truth = Rotation.random(rng=rng).as_matrix()
    R = noisy_rotations(rng, truth, 120, 6.0)
    R[:40] = noisy_rotations(rng, truth @ np.diag([-1.0, 1.0, -1.0]), 40, 15.0)
    assert angle_deg(mean_rotation(R), truth) < 2.5


def test_weights_count_like_repetitions(rng):
    R = noisy_rotations(rng, np.eye(3), 6, 10.0)
    weights = np.array([1.0, 2.0, 1.0, 3.0, 1.0, 1.0])
    repeated = mean_rotation(np.repeat(R, weights.astype(int), axis=0), scale_deg=90.0)
    assert angle_deg(mean_rotation(R, weights, scale_deg=90.0), repeated) < 1e-4


def test_missing_and_weightless_rotations_are_ignored(rng):
    R = noisy_rotations(rng, np.eye(3), 10, 3.0)
    dirty = np.concatenate([R, np.full((1, 3, 3), np.nan), R[:1] @ np.diag([-1.0, -1.0, 1.0])])
    weights = np.array([1.0] * 11 + [0.0])
    assert np.allclose(mean_rotation(dirty, weights), mean_rotation(R))


def test_the_mean_of_nothing_is_the_identity():
    np.testing.assert_array_equal(mean_rotation(np.full((3, 3, 3), np.nan)), np.eye(3))
    np.testing.assert_array_equal(mean_vector(np.full((3, 2), np.nan), scale=1.0), np.zeros(2))


def test_the_vector_mean_ignores_outliers_and_moves_with_its_vectors(rng):
    x = rng.normal(size=(100, 3)) * 0.1
    x[:30] += [5.0, -2.0, 9.0]
    estimate = mean_vector(x, scale=0.2)
    assert np.linalg.norm(estimate) < 0.05
    assert np.allclose(mean_vector(x + 7.0, scale=0.2), estimate + 7.0, atol=1e-6)


def test_the_nearest_rotation_of_a_reflection_is_a_rotation(rng):
    M = rng.normal(size=(20, 3, 3))
    R = nearest_rotation(M)
    assert np.allclose(np.linalg.det(R), 1.0)
    assert np.allclose(R @ np.swapaxes(R, 1, 2), np.eye(3))
    assert np.allclose(nearest_rotation(R), R)


def test_wrong_shapes_are_named():
    with pytest.raises(ValueError, match=r"R: expected rotations of shape \(N, 3, 3\)"):
        mean_rotation(np.eye(3))
    with pytest.raises(ValueError, match=r"weights: expected shape \(2,\)"):
        mean_rotation(np.stack([np.eye(3)] * 2), np.ones(3))
    with pytest.raises(ValueError, match=r"x: expected vectors"):
        mean_vector(np.ones(3), scale=1.0)
