"""Captured joints on another body keep their directions, and feet in contact stay in contact."""

import numpy as np
import pytest

from benchmarks.performers.action import PERFORMERS, bone_ratios
from benchmarks.performers.bodies import LIMBS, PARENT_OF, limb_lengths_m, with_bones
from imocap_core.conventions import EVAL_14

ROW = EVAL_14.index


def joints() -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.normal(0, 0.3, (5, 14, 3)) + [1.0, 2.0, 1.0]


def test_bones_get_their_ratios_and_keep_their_directions() -> None:
    ratio = bone_ratios("walk")["A"]
    before, after = joints(), with_bones(joints(), ratio)
    for far, near in PARENT_OF.items():
        a, b = (x[:, ROW(far)] - x[:, ROW(near)] for x in (before, after))
        np.testing.assert_allclose(b, ratio[far] * a, atol=1e-12)
    for far in LIMBS:
        expected = ratio[far] * limb_lengths_m(before)[far]
        assert limb_lengths_m(after)[far] == pytest.approx(expected)


def test_the_mean_body_changes_nothing() -> None:
    ratio = dict.fromkeys(bone_ratios("walk")["A"], 1.0)
    np.testing.assert_allclose(with_bones(joints(), ratio), joints(), atol=1e-12)


def test_a_foot_in_contact_stays_in_contact() -> None:
    """Legs of one ratio: a foot that stands still in the capture stands still."""
    standing = joints()
    standing[:, ROW("left_ankle")] = standing[0, ROW("left_ankle")]
    hips = standing[:, [ROW("left_hip"), ROW("right_hip")]].mean(axis=1)
    ratio = dict.fromkeys(bone_ratios("walk")["A"], 1.1)
    moved = with_bones(standing, ratio)[:, ROW("left_ankle")]
    assert np.ptp(moved, axis=0).max() < 1e-12
    assert np.ptp(hips, axis=0).max() > 0.1


def test_performers_have_bodies_of_their_own() -> None:
    first, second = bone_ratios("walk").values()
    assert max(abs(first[bone] - second[bone]) for bone in LIMBS) > 0.02
    assert bone_ratios("walk") == bone_ratios("walk")
    assert set(bone_ratios("walk")) == set(PERFORMERS)
