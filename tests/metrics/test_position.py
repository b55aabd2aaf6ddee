"""Position errors against cases worked by hand, and the invariances that each one claims; joints
that are not aligned on, and vertices."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.metrics import position
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


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


@pytest.fixture
def motion(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(scale=0.4, size=(6, 12, 3))


def test_mpjpe_by_hand():
    # Frame 0: joints off by 30 and 50 mm (3-4-5 triangle), frame 1: 0 and 20 mm -> (40 + 10) / 2.
    true = np.zeros((2, 2, 3))
    predicted = np.array([[[0.03, 0, 0], [0, 0.03, 0.04]], [[0, 0, 0], [0, 0, -0.02]]])
    assert position.mpjpe_mm(predicted, true) == pytest.approx(25.0)
    np.testing.assert_allclose(position.mean_joint_errors_mm(predicted, true), [15.0, 35.0])


def test_missing_joint_leaves_its_frame_mean_to_the_others() -> None:
    true = np.zeros((2, 2, 3))
    predicted = np.array([[[0.01, 0, 0], [np.nan] * 3], [[0, 0.02, 0], [0, 0, 0.04]]])
    # Frame means 10 and 30; a mean over all joints at once would give 70 / 3.
    assert position.mpjpe_mm(predicted, true) == pytest.approx(20.0)
    predicted[0] = np.nan
    assert position.mpjpe_mm(predicted, true) == pytest.approx(30.0)
    assert np.isnan(position.mpjpe_mm(predicted * np.nan, true))


def test_scaled_by_hand():
    # Truth has norm 5, prediction norm 10 in another direction: halved, then sqrt(2) * 5 apart.
    true = np.array([[[3.0, 4.0, 0.0]]])
    predicted = np.array([[[-8.0, 6.0, 0.0]]])
    assert position.mpjpe_scaled_mm(predicted, true) == pytest.approx(1000 * 5 * np.sqrt(2))


def test_scaled_ignores_scale_per_frame(motion: np.ndarray, rng: np.random.Generator) -> None:
    predicted = motion + rng.normal(scale=0.05, size=motion.shape)
    scales = rng.uniform(0.5, 2, size=(len(motion), 1, 1))
    assert position.mpjpe_scaled_mm(scales * predicted, motion) == pytest.approx(
        position.mpjpe_scaled_mm(predicted, motion)
    )
    assert position.mpjpe_scaled_mm(3 * motion, motion) == pytest.approx(0, abs=1e-9)
    assert position.mpjpe_mm(3 * motion, motion) > 100


def test_scaled_takes_both_norms_over_the_same_joints(motion: np.ndarray) -> None:
    predicted = 2 * motion
    predicted[:, 0] = np.nan
    assert position.mpjpe_scaled_mm(predicted, motion) == pytest.approx(0, abs=1e-9)


def test_pa_ignores_a_similarity_per_frame(motion: np.ndarray, rng: np.random.Generator) -> None:
    predicted = motion + rng.normal(scale=0.05, size=motion.shape)
    R = Rotation.random(len(motion), rng=rng).as_matrix()
    t = rng.normal(size=(len(motion), 1, 3))
    moved = 1.7 * np.einsum("tab,tjb->tja", R, predicted) + t
    assert position.pa_mpjpe_mm(moved, motion) == pytest.approx(
        position.pa_mpjpe_mm(predicted, motion)
    )
    assert 20 < position.pa_mpjpe_mm(predicted, motion) < position.mpjpe_mm(predicted, motion)


def test_pa_does_not_forgive_a_mirror_image(motion: np.ndarray) -> None:
    assert position.pa_mpjpe_mm(motion * [-1, 1, 1], motion) > 100


def test_acceleration_by_hand():
    # x = 0.5 a t^2 with a = 2 m/s^2 against rest, at 10 frames a second.
    seconds = np.arange(5) / 10
    predicted = np.zeros((5, 1, 3))
    predicted[:, 0, 1] = seconds**2
    error = position.acceleration_error_m_s2(
        predicted, np.zeros_like(predicted), np.arange(5) + 40, fps=10
    )
    assert error == pytest.approx(2.0)


def test_acceleration_ignores_an_even_drift_and_jumps_no_gap(motion: np.ndarray) -> None:
    drift = motion + np.arange(6)[:, None, None] * [0.3, 0.1, 0.0] + 5
    assert position.acceleration_error_m_s2(drift, motion, np.arange(6), 30) == pytest.approx(
        0, abs=1e-9
    )
    jump = motion.copy()
    jump[3:] += 1.0
    assert position.acceleration_error_m_s2(jump, motion, np.arange(6), 30) > 100
    frames = np.array([0, 1, 2, 10, 11, 12])
    assert position.acceleration_error_m_s2(jump, motion, frames, 30) == pytest.approx(0, abs=1e-9)
    assert np.isnan(position.acceleration_error_m_s2(jump, motion, 2 * np.arange(6), 30))


def test_root_is_the_midpoint_of_the_hips_not_the_pelvis_joint(rng: np.random.Generator) -> None:
    joints = rng.normal(size=(4, 24, 3))
    joints[:, SMPL_JOINTS.index("pelvis")] += 9
    relative = position.root_relative(joints, SMPL_JOINTS, EVAL_12)
    np.testing.assert_allclose(position.hip_midpoint(relative, EVAL_12), 0, atol=1e-12)
    np.testing.assert_allclose(position.root_relative(joints + 3, SMPL_JOINTS, EVAL_12), relative)


def test_selection_follows_names_not_positions(rng: np.random.Generator) -> None:
    joints = rng.normal(size=(2, 24, 3))
    order = rng.permutation(24)
    names = [SMPL_JOINTS[i] for i in order]
    np.testing.assert_array_equal(
        position.select_joints(joints[:, order], names, EVAL_12),
        position.select_joints(joints, SMPL_JOINTS, EVAL_12),
    )


@pytest.mark.usefixtures("unchecked_shapes")
def test_misuse_is_named(motion: np.ndarray) -> None:
    assert position.missing_joints(SMPL_JOINTS, ("nose", "head")) == ("nose",)
    with pytest.raises(ValueError, match="lack nose"):
        position.select_joints(np.zeros((24, 3)), SMPL_JOINTS, ["nose"])
    with pytest.raises(ValueError, match="to match its names"):
        position.select_joints(np.zeros((2, 23, 3)), SMPL_JOINTS, EVAL_12)
    with pytest.raises(ValueError, match=r"\(T, J, 3\)"):
        position.joint_errors_mm(motion, motion[:, :5])
    with pytest.raises(ValueError, match="frames must be"):
        position.acceleration_error_m_s2(motion, motion, np.arange(5), 30)


HANDS = np.random.default_rng(0).normal(0.0, 0.05, (5, 2, 21, 3))


def test_where_the_wrist_is_does_not_count() -> None:
    moved = HANDS + np.random.default_rng(1).normal(size=(5, 2, 1, 3))
    assert position.hand_mpjpe_mm(moved, HANDS) == pytest.approx(0.0, abs=1e-9)


def test_one_finger_off_counts_by_its_share() -> None:
    bent = HANDS.copy()
    bent[:, 0, 8] += (0.0, 0.042, 0.0)
    assert position.hand_mpjpe_mm(bent, HANDS) == pytest.approx(1.0)  # 42 mm of one point of 42


def test_turn_and_size_are_taken_out_by_procrustes_alone() -> None:
    turned = 1.3 * HANDS @ Rotation.from_rotvec([0.3, 0.2, -0.5]).as_matrix().T
    assert position.hand_pa_mpjpe_mm(turned, HANDS) == pytest.approx(0.0, abs=1e-6)
    assert position.hand_mpjpe_mm(turned, HANDS) > 10.0


def test_size_alone_is_taken_out_by_scaling() -> None:
    assert position.hand_mpjpe_scaled_mm(1.2 * HANDS, HANDS) == pytest.approx(0.0, abs=1e-9)
    assert position.hand_mpjpe_mm(1.2 * HANDS, HANDS) > 5.0


def test_frames_without_a_hand_are_left_out() -> None:
    some = HANDS.copy()
    some[2:, 1] = np.nan
    assert position.hand_mpjpe_mm(some, HANDS) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.usefixtures("unchecked_shapes")
def test_other_shapes_are_named() -> None:
    with pytest.raises(ValueError, match=r"expected \(T, 2, 21, 3\), got \(5, 21, 3\)"):
        position.hand_mpjpe_mm(HANDS[:, 0], HANDS[:, 0])


ANCHORS = [0, 1, 2, 3]


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
