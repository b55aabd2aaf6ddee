"""Hands are compared about their wrists; Procrustes takes a turn and a size out."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.metrics.position import hand_mpjpe_mm, hand_mpjpe_scaled_mm, hand_pa_mpjpe_mm

HANDS = np.random.default_rng(0).normal(0.0, 0.05, (5, 2, 21, 3))


def test_where_the_wrist_is_does_not_count() -> None:
    moved = HANDS + np.random.default_rng(1).normal(size=(5, 2, 1, 3))
    assert hand_mpjpe_mm(moved, HANDS) == pytest.approx(0.0, abs=1e-9)


def test_one_finger_off_counts_by_its_share() -> None:
    bent = HANDS.copy()
    bent[:, 0, 8] += (0.0, 0.042, 0.0)
    assert hand_mpjpe_mm(bent, HANDS) == pytest.approx(1.0)  # 42 mm of one point of 42


def test_turn_and_size_are_taken_out_by_procrustes_alone() -> None:
    turned = 1.3 * HANDS @ Rotation.from_rotvec([0.3, 0.2, -0.5]).as_matrix().T
    assert hand_pa_mpjpe_mm(turned, HANDS) == pytest.approx(0.0, abs=1e-6)
    assert hand_mpjpe_mm(turned, HANDS) > 10.0


def test_size_alone_is_taken_out_by_scaling() -> None:
    assert hand_mpjpe_scaled_mm(1.2 * HANDS, HANDS) == pytest.approx(0.0, abs=1e-9)
    assert hand_mpjpe_mm(1.2 * HANDS, HANDS) > 5.0


def test_frames_without_a_hand_are_left_out() -> None:
    some = HANDS.copy()
    some[2:, 1] = np.nan
    assert hand_mpjpe_mm(some, HANDS) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.usefixtures("unchecked_shapes")
def test_other_shapes_are_named() -> None:
    with pytest.raises(ValueError, match=r"expected \(T, 2, 21, 3\), got \(5, 21, 3\)"):
        hand_mpjpe_mm(HANDS[:, 0], HANDS[:, 0])
