"""Velocities distinguish equal poses; joints count by their weights."""

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.params import SyncParams
from imocap_core.problem.synchronisation import joint_weights_of
from imocap_core.sync.pairwise.distance_matrix import distance_matrix
from imocap_core.sync.pairwise.velocity import with_velocity
from tests.sync.test_synchronise import PARAMS, error_s, estimated, run

FPS = 30.0


def swing(phase: np.ndarray) -> np.ndarray:
    """A movement there and back: every pose but the farthest is passed twice, (T, 6, 3)."""
    rng = np.random.default_rng(1)
    rest, way = rng.normal(size=(2, 6, 3))
    return np.asarray(rest + 0.3 * np.sin(np.pi * phase)[:, None, None] * way)


def test_poses_that_are_passed_twice_are_distinguished_by_velocity() -> None:
    phase = np.linspace(0.0, 1.0, 31)
    clips = [swing(phase), swing(phase)]
    plain = distance_matrix(clips, None, None, [FPS] * 2, PARAMS)
    moving = distance_matrix(clips, None, None, [FPS] * 2, replace(PARAMS, velocity_weight_s=0.2))
    there, back = 10, 20  # the same pose on the way there and on the way back
    assert plain.block(0, 1)[there, back] == pytest.approx(0.0, abs=1e-6)
    assert moving.block(0, 1)[there, back] > 0.01
    assert moving.block(0, 1)[there, there] == pytest.approx(0.0, abs=1e-6)


def test_a_velocity_is_that_of_the_slow_twin() -> None:
    rng = np.random.default_rng(2)
    poses, weights = rng.normal(size=(9, 4, 3)), np.ones((9, 4))
    weights[5, 2] = 0.0
    points, point_weights = with_velocity(poses, weights, 20.0, 0.5)
    for t in range(9):
        a, b = max(t - 2, 0), min(t + 2, 8)
        ends = []
        for k in (a, b):
            w = weights[k][:, None]
            ends.append(np.where(w > 0, poses[k] - (w * poses[k]).sum(0) / w.sum(), 0.0))
        np.testing.assert_allclose(points[t, 4:], 0.5 * (ends[1] - ends[0]) / ((b - a) / 20.0))
        np.testing.assert_allclose(point_weights[t, 4:], weights[a] * weights[b])


def test_of_points_without_velocity_distances_stay_what_they_are() -> None:
    rng = np.random.default_rng(3)
    still = [np.repeat(rng.normal(size=(1, 6, 3)), 5, axis=0) for _ in range(2)]
    plain = distance_matrix(still, None, None, [FPS] * 2, PARAMS)
    moving = distance_matrix(still, None, None, [FPS] * 2, replace(PARAMS, velocity_weight_s=1.0))
    np.testing.assert_allclose(moving.block(0, 1), plain.block(0, 1), atol=1e-9)


def test_synchronisation_with_velocity_finds_made_warps() -> None:
    rng = np.random.default_rng(4)
    phases = [np.linspace(0.5, 5.5, 150), 0.5 + 5.0 * np.linspace(0, 1, 110) ** 1.2]
    poses = [estimated(p, rng, 0.01) for p in phases]
    result = run(poses, replace(PARAMS, velocity_weight_s=0.1))
    assert error_s(phases, result.reference_frame, result.reference).mean() < 0.05


def test_a_joint_of_weight_zero_does_not_count_and_a_heavier_one_counts_more() -> None:
    rng = np.random.default_rng(5)
    clips = list(rng.normal(size=(2, 8, 6, 3)))
    moved = [clips[0], clips[1].copy()]
    moved[1][:, 2] += rng.normal(size=(8, 3))
    plain = replace(PARAMS, normalise_scale=False)

    def squares(poses: list[np.ndarray], weight: float) -> np.ndarray:
        weights = np.ones(6)
        weights[2] = weight
        return distance_matrix(poses, None, weights, [FPS] * 2, plain).block(0, 1)

    np.testing.assert_allclose(squares(clips, 0.0), squares(moved, 0.0))
    far = [clips[0], clips[0].copy()]
    far[1][:, 2] += 3.0
    diagonal = [np.diag(squares(far, w)[:8, 8:]) for w in (0.5, 1.0, 2.0)]
    assert (diagonal[0] < diagonal[1]).all()
    assert (diagonal[1] < diagonal[2]).all()


def test_joint_weights_are_given_by_name() -> None:
    assert joint_weights_of(SyncParams()) is None
    weights = joint_weights_of(SyncParams(joint_weights={"left_wrist": 2.0}))
    assert weights is not None
    assert weights[SMPL_JOINTS.index("left_wrist")] == 2.0
    assert weights.sum() == 25.0
    with pytest.raises(ValueError, match="got left_paw"):
        SyncParams(joint_weights={"left_paw": 2.0})
    with pytest.raises(ValueError, match="at least three joints"):
        SyncParams(joint_weights=dict.fromkeys(SMPL_JOINTS[2:], 0.0))
