"""Position errors against cases worked by hand, and the invariances that each one claims."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.metrics import position


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
