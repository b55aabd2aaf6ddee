"""Cardan angles, standard deviations of angles, and means over performances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.biomechanics.angle_spread import angle_spreads_deg
from imocap_core.biomechanics.cardan import yxy, yxz, zxy
from imocap_core.biomechanics.mean_curve import mean_curve, without_steps
from imocap_core.conventions import SMPL_JOINTS

DRAWS = 4000
UP = np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize(("split", "axes"), [(zxy, "ZXY"), (yxz, "YXZ")])
def test_three_angles_give_their_rotation_back(split, axes: str) -> None:  # type: ignore[no-untyped-def]
    R = Rotation.random(200, np.random.default_rng(0)).as_matrix()
    again = Rotation.from_euler(axes, split(R)).as_matrix()
    np.testing.assert_allclose(again, R, atol=1e-9)


def test_plane_elevation_and_rotation_give_their_rotation_back() -> None:
    R = Rotation.random(200, np.random.default_rng(1)).as_matrix()
    plane, elevation, rotation = yxy(R).T
    there = np.isfinite(plane)
    assert there.mean() > 0.95
    again = Rotation.from_euler("YXY", np.stack([plane, -elevation, rotation], 1)[there])
    np.testing.assert_allclose(again.as_matrix(), R[there], atol=1e-9)


def test_standard_deviations_are_those_of_angles_of_disturbed_joints() -> None:
    rng = np.random.default_rng(2)
    joints = rng.normal(size=(1, 24, 3))
    hip, knee, ankle = (SMPL_JOINTS.index(f"right_{n}") for n in ("hip", "knee", "ankle"))
    joints[0, hip], joints[0, knee], joints[0, ankle] = (0, 0.9, 0), (0, 0.5, 0), (0.1, 0.15, 0.2)
    roots = rng.normal(size=(1, 24, 3, 3)) * 8
    covariance = roots @ np.swapaxes(roots, -1, -2)
    claimed = angle_spreads_deg(joints, covariance, UP, 0.0)["right_knee_flexion"][0]
    noise = np.einsum("jik,njk->nji", roots[0], rng.normal(size=(DRAWS, 24, 3))) / 1000
    drawn = joints + noise
    upper, lower = drawn[:, knee] - drawn[:, hip], drawn[:, ankle] - drawn[:, knee]
    cosine = (upper * lower).sum(1) / np.linalg.norm(upper, axis=1) / np.linalg.norm(lower, axis=1)
    assert np.degrees(np.arccos(cosine)).std() == pytest.approx(claimed, rel=0.06)


def test_hips_err_by_opposite_amounts_about_their_middle() -> None:
    rng = np.random.default_rng(7)
    joints = rng.normal(size=(1, 24, 3))
    names = ("left_hip", "right_hip", "right_knee", "spine3", "neck")
    left, right, knee, spine, neck = (SMPL_JOINTS.index(name) for name in names)
    joints[0, [left, right]] = [(0.08, 0.9, 0.03), (-0.08, 0.93, -0.02)]
    joints[0, [knee, spine, neck]] = [(-0.2, 0.5, 0.1), (0, 1.2, 0), (0.05, 1.4, 0)]
    roots = 4 * rng.normal(size=(1, 24, 3, 3))
    roots[0, right] = -roots[0, left]
    covariance = roots @ np.swapaxes(roots, -1, -2)
    claimed = angle_spreads_deg(joints, covariance, UP, 3.0)
    draws = rng.normal(size=(DRAWS, 24, 3))
    draws[:, right] = draws[:, left]
    drawn = joints + np.einsum("jik,njk->nji", roots[0], draws) / 1000
    line, thigh = drawn[:, right] - drawn[:, left], drawn[:, right] - drawn[:, knee]
    trunk = drawn[:, neck] - drawn[:, spine]
    across = line / np.linalg.norm(line, axis=1, keepdims=True)

    def sine_sd(direction: np.ndarray) -> float:
        unit = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
        return float(np.degrees(np.arcsin((across * unit).sum(axis=-1))).std())

    turn = np.degrees(np.arctan2(line[:, 2], line[:, 0]))
    assert np.std((turn + 90) % 360) == pytest.approx(claimed["pelvis_rotation"][0], rel=0.06)
    expected = np.hypot(sine_sd(UP), 3.0)
    assert claimed["pelvis_obliquity"][0] == pytest.approx(expected, rel=0.06)
    assert claimed["right_hip_adduction"][0] == pytest.approx(sine_sd(thigh), rel=0.06)
    assert claimed["trunk_right_bending"][0] == pytest.approx(sine_sd(trunk), rel=0.06)


def test_a_straight_limb_has_a_standard_deviation_too() -> None:
    joints = np.zeros((1, 24, 3))
    joints[0, :, 1] = np.linspace(1.7, 0.0, 24)
    joints[0, SMPL_JOINTS.index("left_hip"), 0] = 0.2
    spreads = angle_spreads_deg(joints, np.tile(100 * np.eye(3), (1, 24, 1, 1)), UP, 1.0)
    assert all(np.isfinite(values).all() and (values > 0).all() for values in spreads.values())


def test_the_mean_is_over_the_performances_that_show_the_moment() -> None:
    first, second = np.array([10.0, 20.0, 30.0]), np.array([14.0, 26.0, np.nan]) + 360
    inside = [np.array([True, True, True]), np.array([False, True, True])]
    mean = mean_curve([first, second], inside)
    np.testing.assert_array_equal(mean.n, [1, 2, 1])
    np.testing.assert_allclose(mean.mean_deg, [10, 23, 30])
    np.testing.assert_allclose(mean.sd_deg, [np.nan, np.sqrt(18), np.nan])
    np.testing.assert_allclose(without_steps(mean), [10, np.nan, np.nan])
