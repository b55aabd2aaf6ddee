"""Distances in a video's own axes, against one pair at a time."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from imocap_core.sync.maps import BandedMap
from imocap_core.sync.procrustes import centred, rotations_onto
from imocap_core.sync.warp.leave_one_out_template import axis_precisions, squared_view_distances


def all_squares(*scene: Any) -> np.ndarray:
    """Of all frames and positions."""
    return squared_view_distances(*scene)(slice(None), slice(None))


def test_is_the_weighted_distance_of_every_pair() -> None:
    rng = np.random.default_rng(0)
    others = rng.normal(size=(9, 10, 3))
    R_other_from_pose = Rotation.random(random_state=1).as_matrix()
    poses = others[:7] @ R_other_from_pose + rng.normal(size=(7, 10, 3)) * [0.1, 0.1, 0.25]
    w, u, maps = np.ones((7, 10)), np.ones((9, 10)), BandedMap.of(np.eye(7, 9))
    squares = all_squares(poses, w, others, u, maps, 5.0)

    x, y = centred(poses, w), centred(others, u)
    R = rotations_onto(x, y[:7], w, 5.0)
    precision = axis_precisions(x - np.einsum("nab,nja->njb", R, y[:7]), w)
    naive = [
        [float((((x[t] - y[s] @ R[t]) ** 2) * precision).sum(-1).mean()) for s in range(9)]
        for t in range(7)
    ]
    np.testing.assert_allclose(squares, naive, atol=1e-12)
    assert precision[2] < 0.5 * precision[0]


def test_rotations_are_recovered_and_smooth() -> None:
    rng = np.random.default_rng(2)
    truth = Rotation.random(random_state=3).as_matrix()
    poses, ones = rng.normal(size=(40, 12, 3)), np.ones((40, 12))
    targets = poses @ truth.T + 0.3 * rng.normal(size=poses.shape)

    def spread(window: float) -> float:
        R = rotations_onto(poses, targets, ones, window)
        return float(np.linalg.norm(R - truth, axis=(1, 2)).mean())

    assert spread(8.0) < 0.5 * spread(0.0)


def test_missing_joints_do_not_count() -> None:
    rng = np.random.default_rng(4)
    poses, others = rng.normal(size=(6, 10, 3)), rng.normal(size=(8, 10, 3))
    w, u, maps = np.ones((6, 10)), np.ones((8, 10)), BandedMap.of(rng.random((6, 8)))
    w[:, 4:] = 0.0
    u[:, 4:] = 0.0
    whole = all_squares(poses, w, others, u, maps, 2.0)
    poses[:, 4:], others[:, 4:] = np.nan, 50.0
    np.testing.assert_allclose(all_squares(poses, w, others, u, maps, 2.0), whole)
    u[2] = 0.0
    assert np.isnan(all_squares(poses, w, others, u, maps, 2.0)[:, 2]).all()


def test_equal_axes_have_equal_precision() -> None:
    residuals = np.random.default_rng(5).normal(size=(300, 20, 3))
    np.testing.assert_allclose(axis_precisions(residuals, np.ones((300, 20))), 1.0, atol=0.1)
