"""Persistent differences of two videos, and the outliers that they reveal."""

import numpy as np
from scipy.spatial.transform import Rotation

from imocap_core.sync.procrustes import centred, rotations_onto
from imocap_core.sync.screening.decisions import find_outliers, outlier_scores
from imocap_core.sync.screening.pose_evidence import (
    expected_by,
    expected_squares,
    persistent_differences,
    persistent_squares,
    soft_maps,
    squares_between,
    typical_squares,
    warp_residuals,
)
from tests.sync.test_synchronise import pose_at


def test_is_the_distance_of_every_frame_to_its_mean_counterpart() -> None:
    rng = np.random.default_rng(0)
    poses, others = rng.normal(size=(6, 5, 3)), rng.normal(size=(8, 5, 3))
    w, u, maps = rng.random((6, 5)), rng.random((8, 5)), rng.random((6, 8))
    w[2, 1], u[:, 3] = 0.0, 0.0
    maps /= maps.sum(axis=1, keepdims=True)
    squares = persistent_squares(poses, w, others, u, maps, window=2.0)

    about = centred(others, u)
    mean = np.zeros((6, 5, 3))
    both = np.zeros((6, 5))
    for t in range(6):
        for j in (0, 1, 2, 4):
            share = maps[t] * u[:, j]
            mean[t, j] = share @ about[:, j] / share.sum()
            both[t, j] = w[t, j] * share.sum()
    x, y = centred(poses, both), centred(mean, both)
    R = rotations_onto(x, y, both, 2.0)
    naive = [
        sum(both[t, j] * ((x[t, j] - y[t, j] @ R[t]) ** 2).sum() for j in range(5)) / both[t].sum()
        for t in range(6)
    ]
    np.testing.assert_allclose(squares, naive, atol=1e-12)


def test_a_rotation_of_the_whole_is_no_difference_and_missing_frames_are_nan() -> None:
    pose = pose_at(np.linspace(0, 4, 60))
    turn = Rotation.random(random_state=3).as_matrix()
    w = np.ones(pose.shape[:2])
    w[7] = 0.0
    square = persistent_squares(
        pose @ turn + [1.0, 2.0, 3.0], w, pose, np.ones_like(w), np.eye(60), 15.0
    )
    assert np.isnan(square[7])
    np.testing.assert_allclose(np.delete(square, 7), 0.0, atol=1e-18)


def test_noise_raises_it_less_than_a_lasting_difference_does() -> None:
    rng = np.random.default_rng(6)
    w = [np.ones((60, 12))] * 2
    pose, fps = pose_at(np.linspace(0, 6, 60)), [15.0, 15.0]

    def both(other: np.ndarray) -> tuple[float, float]:
        squares = squares_between([pose, other], w, [pose, other], w)
        typical = typical_squares(squares)
        plain = warp_residuals(expected_squares(squares, fps, typical, 4.0), 2)
        maps = soft_maps(squares, fps, typical, 4.0)
        persistent = persistent_differences([pose, other], w, maps, fps, 1.0)
        assert np.isnan(np.diag(persistent)).all()
        return np.nanmin(plain), np.nanmin(persistent)  # the better direction counts

    elsewhere = pose.copy()
    elsewhere[:, :4] += rng.normal(0.0, 0.12, (4, 3))  # a limb held otherwise all the time
    noisy = both(pose + rng.normal(0.0, 0.12, pose.shape))
    lasting = both(elsewhere)
    assert noisy[1] < 0.65 * noisy[0]
    assert lasting[1] > 0.8 * lasting[0]


def test_another_action_of_the_same_rhythm_is_an_outlier_unless_it_follows_clearly() -> None:
    residuals, gains = np.full((4, 4), 0.07), np.full((4, 4), 0.3)
    persistent = np.full((4, 4), 0.05)
    assert find_outliers(residuals, gains, persistent)[0] == []
    persistent[2] = persistent[:, 2] = 0.12
    assert find_outliers(residuals, gains, persistent)[0] == [2]
    assert find_outliers(residuals, gains + 0.3, persistent)[0] == []
    larger, smaller = (outlier_scores(residuals, gains, k * persistent)[2] for k in (1.0, 0.9))
    assert larger > smaller


def test_one_direction_is_enough_and_a_video_without_any_pair_has_no_score() -> None:
    residuals, gains = np.full((4, 4), 0.07), np.full((4, 4), 0.3)
    persistent = np.full((4, 4), 0.05)
    persistent[:3, 3] = 0.12  # a short clip: the others don't fit into it
    assert find_outliers(residuals, gains, persistent)[0] == []
    for pairs in (residuals, gains, persistent):
        pairs[0] = pairs[:, 0] = np.nan
    assert np.isnan(outlier_scores(residuals, gains, persistent)[0])


def test_expected_squares_from_given_maps_equal_those_that_compute_the_maps() -> None:
    rng = np.random.default_rng(2)
    shown = [pose_at(np.linspace(0, 6, n)) for n in (40, 30)]
    poses = [x + rng.normal(0.0, 0.02, x.shape) for x in shown]
    w, fps = [np.ones(x.shape[:2]) for x in poses], [15.0, 12.0]
    w[0][3] = 0.0
    squares = squares_between(poses, w, poses, w)
    typical = typical_squares(squares)
    expected = expected_squares(squares, fps, typical, 4.0)
    by_maps = expected_by(soft_maps(squares, fps, typical, 4.0), squares)
    assert by_maps.keys() == expected.keys() == {(0, 1), (1, 0)}
    for pair, squared in expected.items():
        np.testing.assert_array_equal(by_maps[pair], squared)
