"""Features of joints whose errors are independent."""

import numpy as np

from imocap_core.sync.warp.leave_one_out_template import whitening


def errors(rng: np.random.Generator, n: int = 4000) -> np.ndarray:
    """Six joints: three wrong together, three alone, the last three times as much."""
    noise = rng.normal(size=(n, 6, 3))
    noise[:, :3] += 2.0 * rng.normal(size=(n, 1, 3))
    noise[:, 5] *= 3.0
    return noise


def test_features_are_nearly_independent() -> None:
    residuals = errors(np.random.default_rng(0))
    W = whitening(residuals, np.ones(residuals.shape[:2]))
    before = np.corrcoef(residuals[..., 0].T)
    after = np.corrcoef((W @ residuals)[..., 0].T)
    off = ~np.eye(6, dtype=bool)
    assert np.abs(after[off]).max() < 0.35
    assert np.abs(before[off]).max() > 0.7
    spread = (W @ residuals).std(axis=(0, 2))
    assert spread.max() < 1.6 * spread.min()


def test_missing_joints_or_few_frames_leave_joints_as_they_are() -> None:
    residuals = errors(np.random.default_rng(1), 300)
    weights = np.ones(residuals.shape[:2])
    weights[5, 2] = 0.0
    np.testing.assert_array_equal(whitening(residuals, weights), np.eye(6))
    np.testing.assert_array_equal(whitening(residuals[:9], np.ones((9, 6))), np.eye(6))
