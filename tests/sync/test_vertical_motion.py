"""Jumps match by the height of the trunk; who stays on the ground is matched by poses alone."""

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.sync.affinity import distance_matrix
from imocap_core.sync.comparable_poses import (
    mean_of_known,
    of_one_amplitude,
    picture_heights,
    spread_over,
    squared_differences,
    vertical_motion,
)
from imocap_core.sync.evidence import SyncEvidence
from imocap_core.sync.synchronise import synchronise
from tests.sync.test_synchronise import PARAMS

FPS = 30.0
TRUNK = (0, 1, 2, 3)


def jumps(T: int, offset_s: float, height_m: float = 0.15) -> np.ndarray:
    """Height (T,) of somebody who jumps twice a second."""
    return height_m * np.sin(4 * np.pi * (np.arange(T) / FPS - offset_s))


def still_poses(T: int, seed: int) -> np.ndarray:
    """A pose that only an estimator's errors change, (T, 6, 3) metres."""
    pose = np.random.default_rng(0).normal(scale=0.3, size=(6, 3))
    return pose + np.random.default_rng(seed).normal(scale=0.01, size=(T, 6, 3))


def test_landings_fall_on_landings_where_the_pose_does_not_change() -> None:
    T, late_s = 75, 0.2
    poses = [still_poses(T, 1), still_poses(T, 2)]
    heights = [jumps(T, 0.0), jumps(T, late_s, 0.25)]
    evidence = SyncEvidence(poses, [FPS] * 2, heights=heights, reference=0)
    sync = synchronise(evidence, replace(PARAMS, outliers="ignore"), np.random.default_rng(0))
    there = jumps(T, 0.0)[np.rint(sync.reference_frame[1][10:65]).astype(int)]
    assert np.corrcoef(there, heights[1][10:65])[0, 1] > 0.95


def test_heights_in_metres_whatever_the_size_in_the_picture() -> None:
    T = 40
    poses, height = still_poses(T, 1), jumps(T, 0.0)
    for focal in (200.0, 700.0):
        xy = focal * (poses[..., :2] - np.array([0.0, 1.0]) * height[:, None, None])
        found = picture_heights(xy, np.ones((T, 6)), poses, TRUNK, FPS)
        found = found + poses[:, :4, 1].mean(axis=1)  # without the pose's own change
        assert np.corrcoef(found, height)[0, 1] > 0.999
        assert np.ptp(found) == pytest.approx(np.ptp(height), rel=0.03)


def test_heights_without_size_or_trunk_are_unknown() -> None:
    poses, weight = still_poses(5, 1), np.ones((5, 6))
    weight[2, 0] = 0.0
    xy = 100.0 * poses[..., :2]
    assert np.isnan(picture_heights(xy, weight, poses, TRUNK, FPS)).tolist() == [0, 0, 1, 0, 0]
    assert np.isnan(picture_heights(0.0 * xy, weight, poses, TRUNK, FPS)).all()


def test_a_drifting_camera_is_no_vertical_motion() -> None:
    time_s = np.arange(300) / FPS
    drift, jumping = 0.3 * np.sin(2 * np.pi * time_s / 20.0), jumps(300, 0.0)
    moved = vertical_motion(jumping + drift, FPS)
    inside = slice(15, -15)
    assert np.abs(moved - jumping)[inside].max() < 0.2 * np.abs(jumping).max()


def test_who_stays_on_the_ground_changes_no_distance() -> None:
    poses = [still_poses(60, 1), still_poses(60, 2)]
    plain = distance_matrix(poses, None, None, [FPS] * 2, PARAMS)
    noise = [np.random.default_rng(v).normal(scale=0.01, size=60) for v in (3, 4)]
    still = distance_matrix(poses, None, None, [FPS] * 2, PARAMS, heights=noise)
    one_jumps = [jumps(60, 0.0), noise[1]]
    jumping = distance_matrix(poses, None, None, [FPS] * 2, PARAMS, heights=one_jumps)
    unknown = distance_matrix(
        poses, None, None, [FPS] * 2, PARAMS, heights=[np.full(60, np.nan)] * 2
    )
    least = PARAMS.least_difference_m**2
    np.testing.assert_array_equal(unknown.block(0, 1), plain.block(0, 1))
    for distances in (still, jumping):
        assert np.abs(distances.block(0, 1) - plain.block(0, 1)).mean() < 0.05 * least


def test_all_videos_get_the_smallest_amplitude() -> None:
    motions = of_one_amplitude([jumps(90, 0.0, 0.4), jumps(90, 0.1, 0.2)], 0.04)
    tops = [np.abs(m).max() for m in motions]
    assert tops[0] == pytest.approx(tops[1], rel=0.02)
    assert 0.19 < tops[0] < 0.2


def test_differences_and_means_of_what_is_known() -> None:
    a, b = np.array([0.0, np.nan]), np.array([3.0, 4.0])
    np.testing.assert_array_equal(squared_differences(a, b), [[9.0, 16.0], [0.0, 0.0]])
    np.testing.assert_array_equal(mean_of_known([a, b])[:1], [1.5])
    assert mean_of_known([a, a * np.nan])[1:].tolist() == pytest.approx([np.nan], nan_ok=True)
    np.testing.assert_allclose(spread_over(np.array([0.0, 1.0]), None, 4), [0, 0.25, 0.5, 0.75, 1])
