"""Cameras from 3D-2D pairs: recovered from noisy pairs, refused when there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.actions.resection import resect
from imocap_core.camera.projection import intrinsics, project

K = intrinsics(1145.0, (1000, 1002)) + np.array([[0, 0, 12.0], [0, 0, 14.0], [0, 0, 0]])
R = Rotation.from_euler("xyz", [100, 10, 40], degrees=True).as_matrix()
T = -R @ np.array([2.0, -4.5, 1.5])


def pairs(noise_px: float, outliers: float, count: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    target = np.array([2.0, -4.5, 1.5]) + R.T @ np.array([0, 0, 5.0])
    world = target + rng.uniform(-1.2, 1.2, (count, 3))
    xy = project(world, K, R, T) + rng.normal(0, noise_px, (count, 2))
    wrong = rng.random(count) < outliers
    xy[wrong] += rng.uniform(-300, 300, (wrong.sum(), 2))
    xy[:5] = np.nan
    return world, xy


def test_exact_pairs_give_the_camera() -> None:
    estimate = resect(*pairs(0.0, 0.0), np.random.default_rng(0))
    assert estimate.ok
    np.testing.assert_allclose(estimate.K, K, atol=1e-3)
    np.testing.assert_allclose(estimate.R, R, atol=1e-6)
    np.testing.assert_allclose(estimate.t, T, atol=1e-5)


def test_noise_and_outliers_move_it_little() -> None:
    estimate = resect(*pairs(5.0, 0.1), np.random.default_rng(0))
    assert estimate.ok
    turn = Rotation.from_matrix(estimate.R @ R.T).magnitude()
    assert 0 < np.degrees(turn) < 0.5
    assert estimate.K[0, 0] == pytest.approx(1145, rel=0.02)
    assert np.linalg.norm(estimate.R.T @ estimate.t - R.T @ T) < 0.08
    assert estimate.median_px == pytest.approx(5 * np.sqrt(2 * np.log(2)), abs=1.0)
    assert 0.85 < estimate.inlier_share < 0.95


def test_pairs_without_a_camera_are_said() -> None:
    world, xy = pairs(0.0, 0.0)
    estimate = resect(world, np.random.default_rng(2).permutation(xy), np.random.default_rng(0))
    assert not estimate.ok
    assert "agree with one camera" in estimate.status


def test_misuse_is_named() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="at least 50 pairs, got 4"):
        resect(np.zeros((4, 3)), np.zeros((4, 2)), rng)
    with pytest.raises(ValueError, match=r"expected x_world \(N, 3\)"):
        resect(np.zeros((60, 2)), np.zeros((60, 2)), rng)
