"""The published world metrics: by head, and what each of them forgives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.metrics.trajectory import (
    SEGMENT,
    foot_sliding_mm,
    jitter_10m_s3,
    rte_pct,
    w_mpjpe_mm,
    wa_mpjpe_mm,
)

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


def test_both_forgive_one_similarity_of_a_segment(
    joints: np.ndarray, rng: np.random.Generator
) -> None:
    predicted = joints + rng.normal(scale=0.02, size=joints.shape)
    parts = [_moved(predicted[:SEGMENT], 1.6), predicted[SEGMENT:] - 4]
    moved = np.concatenate(parts)
    for metric in (w_mpjpe_mm, wa_mpjpe_mm):
        assert metric(moved, joints) == pytest.approx(metric(predicted, joints))
        assert metric(_moved(joints, 0.5), joints) == pytest.approx(0, abs=1e-9)
    assert 5 < wa_mpjpe_mm(predicted, joints) < w_mpjpe_mm(predicted, joints)


def test_w_mpjpe_counts_all_that_moves_after_two_frames() -> None:
    # The first two frames agree; afterwards the prediction is 60 mm off: 98 of 100 frames.
    true = np.tile(np.random.default_rng(1).normal(size=(1, 5, 3)), (SEGMENT, 1, 1))
    predicted = true.copy()
    predicted[2:] += [0.0, 0.06, 0.0]
    assert w_mpjpe_mm(predicted, true) == pytest.approx(60 * 0.98)
    assert wa_mpjpe_mm(predicted, true) < 5


def test_each_segment_is_aligned_anew() -> None:
    true = np.tile(np.random.default_rng(1).normal(size=(1, 5, 3)), (2 * SEGMENT, 1, 1))
    predicted = true.copy()
    predicted[SEGMENT:] += 1.0
    assert w_mpjpe_mm(predicted, true) == pytest.approx(0, abs=1e-9)
    predicted[SEGMENT:] -= 1.0
    predicted[SEGMENT - 1 :] += 1.0  # the jump is inside the first segment now
    assert wa_mpjpe_mm(predicted, true) > 5


def test_rte_by_hand() -> None:
    # A path of 4 m out and back; the prediction turns round 0.6 m beside the end. Rigid alignment
    # of three points in a line cannot mend the length: mean error over the path's length.
    true = np.array([[0.0, 0, 0], [2, 0, 0], [0, 0, 0]])
    predicted = np.array([[0.0, 0, 0], [2.6, 0, 0], [0, 0, 0]])
    # centroids 0.6667 and 0.8667: errors 0.2, 0.4, 0.2
    assert rte_pct(predicted, true) == pytest.approx(100 * (0.8 / 3) / 4)


def test_rte_forgives_a_rigid_motion_not_scale(joints: np.ndarray) -> None:
    path = joints[:, 0]
    assert rte_pct(_moved(path), path) == pytest.approx(0, abs=1e-9)
    assert rte_pct(_moved(path, 1.3), path) > 0.1
    assert np.isnan(rte_pct(path, np.zeros_like(path)))


def test_jitter_by_hand() -> None:
    # x = t^3 has the jerk 6 m/s^3; third differences of a cubic are exact.
    seconds = np.arange(8) / 25
    joints = np.zeros((8, 1, 3))
    joints[:, 0, 1] = seconds**3
    assert jitter_10m_s3(joints, np.arange(8), 25.0) == pytest.approx(0.6)


def test_jitter_forgives_acceleration_and_gaps(joints: np.ndarray) -> None:
    frames = np.arange(len(joints))
    falling = joints + 0.01 * frames[:, None, None] ** 2
    error = jitter_10m_s3(joints, frames, 30.0)
    assert jitter_10m_s3(_moved(falling), frames, 30.0) == pytest.approx(error)
    assert np.isnan(jitter_10m_s3(joints, 2 * frames, 30.0))
    jump = np.zeros((8, 1, 3))
    jump[4:] += 1.0
    gap = np.array([0, 1, 2, 3, 10, 11, 12, 13])
    assert jitter_10m_s3(jump, gap, 30.0) == 0


def test_foot_sliding_by_hand() -> None:
    # One point stands and is predicted to creep 3 mm a frame; the other strides 50 mm a frame.
    true = np.zeros((10, 2, 3))
    true[:, 1, 0] = 0.05 * np.arange(10)
    predicted = true.copy()
    predicted[:, 0, 2] += 0.003 * np.arange(10)
    frames = np.arange(10)
    assert foot_sliding_mm(predicted, true, frames, 30.0) == pytest.approx(3.0)
    assert foot_sliding_mm(_moved(predicted), true, frames, 30.0) == pytest.approx(3.0)
    # at 60 frames a second the same displacement a frame is twice as fast
    assert foot_sliding_mm(predicted, true, frames, 60.0) == pytest.approx(6.0)
    assert np.isnan(foot_sliding_mm(predicted[:, 1:], true[:, 1:], frames, 30.0))
    assert np.isnan(foot_sliding_mm(predicted, true, 2 * frames, 30.0))
