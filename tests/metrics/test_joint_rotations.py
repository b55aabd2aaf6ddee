"""Angles between rotations, by head and by their invariances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.metrics.whole_body import (
    joint_rotation_errors_deg,
    mpjae_deg,
    rotation_errors_deg,
    segment_rotations,
)


def _random(seed: int, *shape: int) -> np.ndarray:
    count = int(np.prod(shape))
    matrices = Rotation.random(count, rng=np.random.default_rng(seed)).as_matrix()
    return np.asarray(matrices.reshape(*shape, 3, 3))


@pytest.mark.parametrize("angle", [0.0, 1e-5, 30.0, 90.0, 179.9, 180.0])
def test_a_turn_about_one_axis_is_its_angle(angle: float) -> None:
    turned = Rotation.from_euler("y", angle, degrees=True).as_matrix()
    assert rotation_errors_deg(turned, np.eye(3)) == pytest.approx(angle, rel=1e-6, abs=1e-6)


def test_means_by_hand() -> None:
    # Joint 0: 10 and 30 degrees; joint 1: 0 and 20.
    angles = np.array([[10.0, 0.0], [30.0, 20.0]])
    predicted = Rotation.from_euler("x", angles.reshape(-1, 1), degrees=True).as_matrix()
    true = np.tile(np.eye(3), (2, 2, 1, 1))
    np.testing.assert_allclose(
        joint_rotation_errors_deg(predicted.reshape(2, 2, 3, 3), true), [20.0, 10.0]
    )
    assert mpjae_deg(predicted.reshape(2, 2, 3, 3), true) == pytest.approx(15.0)


def test_invariant_to_a_common_rotation_on_either_side() -> None:
    predicted, true, turn = _random(1, 4, 3), _random(2, 4, 3), _random(3, 4, 3)
    error = mpjae_deg(predicted, true)
    assert mpjae_deg(turn @ predicted, turn @ true) == pytest.approx(error)
    assert mpjae_deg(predicted @ turn, true @ turn) == pytest.approx(error)
    assert mpjae_deg(true, predicted) == pytest.approx(error)
    assert mpjae_deg(turn @ predicted, true) != pytest.approx(error)


def test_agrees_with_the_rotation_vector() -> None:
    predicted, true = _random(4, 50), _random(5, 50)
    relative = Rotation.from_matrix(np.swapaxes(true, -1, -2) @ predicted)
    np.testing.assert_allclose(
        rotation_errors_deg(predicted, true), np.degrees(relative.magnitude()), rtol=1e-6
    )


def test_segments_turn_with_every_joint_above_them() -> None:
    R = _random(4, 3, 24)
    segments = segment_rotations(R)
    chain = [SMPL_JOINTS.index(name) for name in ("spine1", "spine2", "spine3")]
    chest = R[:, 0] @ R[:, chain[0]] @ R[:, chain[1]] @ R[:, chain[2]]
    np.testing.assert_allclose(segments["spine3"], chest)
    np.testing.assert_array_equal(segments["pelvis"], R[:, 0])
    neck, head = (SMPL_JOINTS.index(name) for name in ("neck", "head"))
    np.testing.assert_allclose(segments["head"], chest @ R[:, neck] @ R[:, head])
