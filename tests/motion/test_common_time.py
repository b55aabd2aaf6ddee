"""From videos' own frames to one axis: known phases are found again, ends hold, nothing falls."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.motion.multiview.timeline import common_grid, frame_positions, pose_at, values_at


def test_the_grid_spans_all_videos_in_steps_of_the_reference() -> None:
    phases = [np.array([0.0, 0.5, 1.0]), np.array([np.nan, -0.33, 1.21])]
    grid = common_grid(phases, fps=10.0)
    np.testing.assert_allclose(grid, np.arange(-3, 13) / 10, atol=1e-12)
    assert 0.0 in grid


def test_a_video_is_looked_up_where_its_phase_says() -> None:
    phase = np.array([0.0, 0.1, 0.4, 0.5])
    m = frame_positions(phase, np.array([-0.2, 0.0, 0.05, 0.25, 0.5, 0.6]))
    np.testing.assert_allclose(m.position, [0, 0, 0.5, 1.5, 3, 3], atol=1e-6)
    np.testing.assert_array_equal(m.inside, [False, True, True, True, True, False])


def test_own_frames_come_back_from_their_own_phases() -> None:
    rng = np.random.default_rng(0)
    phase = np.cumsum(rng.uniform(0.01, 0.1, 40))
    np.testing.assert_allclose(frame_positions(phase, phase).position, np.arange(40), atol=1e-5)


def test_a_rest_is_stepped_over_and_frames_without_phase_are_bridged() -> None:
    phase = np.array([0.0, 0.1, 0.1, 0.1, 0.2, np.nan, 0.4])
    m = frame_positions(phase, np.array([0.05, 0.15, 0.3]))
    np.testing.assert_allclose(m.position, [0.5, 3.5, 5.0], atol=1e-6)
    assert (np.diff(frame_positions(phase, np.linspace(0, 0.4, 50)).position) >= 0).all()


def test_wrong_axes_are_said() -> None:
    with pytest.raises(ValueError, match="fps: expected > 0, got 0"):
        common_grid([np.zeros(3)], 0)
    with pytest.raises(ValueError, match="phases_s: expected a video with a place on the axis"):
        common_grid([np.full(3, np.nan)], 30)
    with pytest.raises(ValueError, match="phase_s: expected phases that never fall"):
        frame_positions(np.array([0.0, 0.2, 0.1]), np.zeros(1))
    with pytest.raises(ValueError, match="at least one frame with a phase"):
        frame_positions(np.full(3, np.nan), np.zeros(1))


def test_poses_turn_evenly_between_frames_and_stay_on_one_branch() -> None:
    """A joint that turns at one speed does so on any axis, beyond half a turn too."""
    angle = np.linspace(0, 7.0, 30)
    theta = np.concatenate([np.outer(angle, [0, 0, 1]), np.outer(angle, [0.3, 0, 0])], axis=1)
    at = np.linspace(0, 29, 77)
    found = pose_at(theta, at)
    expected = 7.0 * at / 29
    np.testing.assert_allclose(found[:, 2], expected, atol=1e-9)
    np.testing.assert_allclose(found[:, 3], 0.3 * expected, atol=1e-9)
    assert np.abs(np.diff(found, axis=0)).max() < 0.3


def test_poses_at_whole_frames_are_the_poses() -> None:
    theta = Rotation.random(12, rng=1).as_rotvec().reshape(4, 9)
    back = Rotation.from_rotvec(pose_at(theta, np.arange(4.0)).reshape(-1, 3))
    assert (back.inv() * Rotation.from_rotvec(theta.reshape(-1, 3))).magnitude().max() < 1e-7


def test_values_are_linear() -> None:
    values = np.array([[0.0, 1.0], [2.0, 5.0], [4.0, 9.0]])
    np.testing.assert_allclose(values_at(values, np.array([0.0, 0.25, 2.0]))[:, 1], [1, 2, 9])
    np.testing.assert_array_equal(values_at(values[:1], np.zeros(2)), values[[0, 0]])
