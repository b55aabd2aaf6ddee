"""Joints that are not aligned on, and vertices: by head, and the claimed invariances."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.metrics.position import joint_errors_mm, mean_over_frames, pa_mpjpe_mm
from imocap_core.metrics.whole_body import (
    aligned_joint_errors_mm,
    edges_of,
    joint_rotation_errors_deg,
    mpjae_deg,
    pa_pve_mm,
    rotation_errors_deg,
    segment_rotations,
    stretched_edge_shares,
    vertex_distances_mm,
)

ANCHORS = [0, 1, 2, 3]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(8)


@pytest.fixture
def joints(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(scale=0.4, size=(5, 6, 3))


def _moved(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Another similarity transform in each frame."""
    R = Rotation.random(len(points), rng=rng).as_matrix()
    return 1.7 * np.einsum("tab,tjb->tja", R, points) + rng.normal(size=(len(points), 1, 3))


def test_a_joint_that_is_no_anchor_has_its_whole_error(joints: np.ndarray) -> None:
    predicted = joints.copy()
    predicted[:, 5] += [0.03, 0.0, 0.04]
    errors = aligned_joint_errors_mm(predicted, joints, ANCHORS)
    np.testing.assert_allclose(errors, [0, 0, 0, 0, 0, 50], atol=1e-9)


def test_alignment_forgives_a_similarity_of_each_frame(joints, rng):
    predicted = joints + rng.normal(scale=0.05, size=joints.shape)
    errors = aligned_joint_errors_mm(predicted, joints, ANCHORS)
    again = aligned_joint_errors_mm(_moved(predicted, rng), joints, ANCHORS)
    np.testing.assert_allclose(again, errors)
    assert errors.min() > 5


def test_a_missing_joint_is_nan(joints: np.ndarray) -> None:
    true = joints.copy()
    true[:, 4] = np.nan
    errors = aligned_joint_errors_mm(joints, true, ANCHORS)
    np.testing.assert_array_equal(np.isnan(errors), [False] * 4 + [True, False])


def test_pve_by_hand():
    # Vertices off by 30 and 50 mm once the root, 1 m away, is taken off.
    true = np.zeros((1, 2, 3))
    predicted = np.array([[[0.03, 0, 1], [0, 0.03, 1.04]]])
    root = np.array([[0.0, 0, 1]])
    assert _pve_mm(predicted, true, root, np.zeros((1, 3))) == pytest.approx(40.0)


def test_pve_forgives_a_translation_only(joints: np.ndarray, rng: np.random.Generator) -> None:
    predicted = joints + rng.normal(scale=0.05, size=joints.shape)
    error = _pve_mm(predicted, joints, predicted[:, 0], joints[:, 0])
    shifted = predicted + rng.normal(size=(len(joints), 1, 3))
    assert _pve_mm(shifted, joints, shifted[:, 0], joints[:, 0]) == pytest.approx(error)
    assert _pve_mm(1.5 * predicted, joints, 1.5 * predicted[:, 0], joints[:, 0]) > error + 20


def test_pa_pve_forgives_a_similarity(joints: np.ndarray, rng: np.random.Generator) -> None:
    predicted = joints + rng.normal(scale=0.05, size=joints.shape)
    assert pa_pve_mm(_moved(predicted, rng), joints) == pytest.approx(pa_pve_mm(predicted, joints))
    assert pa_pve_mm(_moved(joints, rng), joints) == pytest.approx(0, abs=1e-9)
    assert pa_pve_mm(joints * [-1, 1, 1], joints) > 50
    assert pa_pve_mm(predicted, joints) == pytest.approx(pa_mpjpe_mm(predicted, joints), rel=1e-9)


def test_vertex_distances_are_joint_errors_about_the_roots(joints, rng):
    predicted = joints + rng.normal(scale=0.05, size=joints.shape)
    roots = predicted[:, 0], joints[:, 0]
    expected = joint_errors_mm(predicted - roots[0][:, None], joints - roots[1][:, None])
    np.testing.assert_allclose(vertex_distances_mm(predicted, joints, *roots), expected)


def _pve_mm(*surfaces_and_roots: np.ndarray) -> float:
    return mean_over_frames(vertex_distances_mm(*surfaces_and_roots))


def _random(seed: int, *shape: int) -> np.ndarray:
    count = int(np.prod(shape))
    matrices = Rotation.random(count, rng=np.random.default_rng(seed)).as_matrix()
    return np.asarray(matrices.reshape(*shape, 3, 3))


@pytest.mark.parametrize("angle", [0.0, 1e-5, 30.0, 90.0, 179.9, 180.0])
def test_a_turn_about_one_axis_is_its_angle(angle: float) -> None:
    turned = Rotation.from_euler("y", angle, degrees=True).as_matrix()
    assert rotation_errors_deg(turned, np.eye(3)) == pytest.approx(angle, rel=1e-6, abs=1e-6)


def test_means_by_hand():
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


CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
_SQUARES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
FACES = np.array([t for a, b, c, d in _SQUARES for t in ((a, b, c), (a, c, d))])
R = Rotation.from_euler("xyz", [20, -50, 110], degrees=True).as_matrix()


def test_every_edge_counts_once() -> None:
    assert edges_of(FACES).shape == (12 + 6, 2)  # edges and one diagonal a square


def test_share_by_hand():
    # Twice as high: 4 edges of height are 100 % longer, 4 upright diagonals 58 %, 10 others not.
    high = CUBE * [1.0, 1.0, 2.0]
    shares = stretched_edge_shares(np.stack([CUBE, high, 1.3 * CUBE]), CUBE, edges_of(FACES))
    np.testing.assert_allclose(shares, [0.0, 8 / 18, 0.0])
    shrunk = stretched_edge_shares(0.5 * CUBE[None], CUBE, edges_of(FACES))
    np.testing.assert_allclose(shrunk, [1.0])


def test_share_forgives_a_rigid_motion_and_a_common_scale() -> None:
    bent = (CUBE * [1.0, 1.0, 2.0])[None]
    edges = edges_of(FACES)
    expected = stretched_edge_shares(bent, CUBE, edges)
    moved = stretched_edge_shares(3 * (bent @ R.T) + 7, 3 * CUBE, edges)
    np.testing.assert_allclose(moved, expected)


def test_share_is_that_of_edge_by_edge() -> None:
    moved = CUBE + np.random.default_rng(2).normal(scale=0.4, size=(6, 8, 3))
    edges = edges_of(FACES)
    at_rest = [np.linalg.norm(CUBE[a] - CUBE[b]) for a, b in edges]
    for vertices, share in zip(moved, stretched_edge_shares(moved, CUBE, edges), strict=True):
        lengths = [np.linalg.norm(vertices[a] - vertices[b]) for a, b in edges]
        changes = [abs(now / rest - 1) for now, rest in zip(lengths, at_rest, strict=True)]
        assert share == np.mean([change > 0.4 for change in changes])
        assert 0 < share < 1


def test_an_edge_without_length_is_left_out() -> None:
    rest = CUBE.copy()
    rest[1] = rest[0]
    shares = stretched_edge_shares(CUBE[None], rest, np.array([[0, 1], [2, 3]]))
    np.testing.assert_allclose(shares, [0.0])
