"""Cardan angles, standard deviations of angles, and means over performances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.biomechanics.joint_angles import (
    ANATOMICAL_JOINTS,
    angle_names,
    angle_spreads_deg,
    definition_of,
    distal_in_proximal,
    joint_angles_deg,
    mean_curve,
    mirrored_rotation_covariance,
    rotation_jacobian,
    without_steps,
    yxy,
    yxz,
    zxy,
)
from imocap_core.biomechanics.segments import anatomical_axes
from imocap_core.conventions import SIDES
from imocap_core.motion.state import TWINS

DRAWS = 4000
POSES = (
    Rotation.from_rotvec(0.4 * np.random.default_rng(1).normal(size=(6 * 24, 3)))
    .as_matrix()
    .reshape(6, 24, 3, 3)
)
REST = np.random.default_rng(3).normal(size=(24, 3))


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


def disturbed(R_local: np.ndarray, increments: np.ndarray) -> np.ndarray:
    turns = Rotation.from_rotvec(increments.reshape(-1, 3)).as_matrix()
    return R_local @ turns.reshape(-1, 24, 3, 3)


def relative(R_local: np.ndarray) -> np.ndarray:
    """Rotations (T, 15, 3, 3) of all anatomical joints."""
    axes = {side: anatomical_axes(R_local, REST, side) for side in SIDES}
    of = [definition_of(joint) for joint in ANATOMICAL_JOINTS]
    return np.stack([distal_in_proximal(joint, axes[side]) for side, joint in of], axis=1)


def test_the_jacobian_is_that_of_differences() -> None:
    R = POSES[:3]
    jacobian, before = rotation_jacobian(R, REST), relative(R)
    for column in range(0, 72, 5):
        increments = np.zeros((1, 72))
        increments[0, column] = 1e-6
        change = np.swapaxes(before, -1, -2) @ relative(disturbed(R, increments))
        vectors = Rotation.from_matrix(change.reshape(-1, 3, 3)).as_rotvec().reshape(3, 15, 3)
        np.testing.assert_allclose(jacobian[..., column], vectors / 1e-6, atol=1e-5)


def test_standard_deviations_are_those_of_angles_of_disturbed_rotations() -> None:
    rng = np.random.default_rng(2)
    R, root = POSES[:1], 0.005 * rng.normal(size=(72, 72))
    jacobian = rotation_jacobian(R, REST)[0]
    covariance = np.degrees(np.degrees(jacobian @ (root @ root.T) @ np.swapaxes(jacobian, -1, -2)))
    claimed = angle_spreads_deg(R, REST, covariance[None], tilt_sd_deg=0.0)
    drawn = joint_angles_deg(disturbed(R, rng.normal(size=(DRAWS, 72)) @ root.T), REST)
    assert set(claimed) == set(angle_names())
    for name, angle in drawn.items():
        assert np.std(angle) == pytest.approx(claimed[name][0], rel=0.08), name


def test_the_pelvis_errs_by_the_world_s_tilt_and_its_camera_too() -> None:
    R = np.tile(np.eye(3), (1, 24, 1, 1))
    R[0, 0] = Rotation.from_euler("y", 30, degrees=True).as_matrix()
    none = np.zeros((1, 15, 3, 3))
    tilted = angle_spreads_deg(R, REST, none, tilt_sd_deg=3.0)
    assert tilted["pelvis_rotation"][0] == pytest.approx(0, abs=1e-4)
    assert tilted["pelvis_tilt"][0] == pytest.approx(3, rel=1e-3)
    assert tilted["pelvis_obliquity"][0] == pytest.approx(3, rel=1e-3)
    assert tilted["left_knee_flexion"][0] == 0
    turned = angle_spreads_deg(R, REST, none, tilt_sd_deg=np.nan, camera_sd_deg=np.sqrt(3) * 2)
    assert turned["pelvis_rotation"][0] == pytest.approx(2, rel=1e-3)
    assert np.isnan([turned["pelvis_tilt"][0], turned["pelvis_obliquity"][0]]).all()


def test_covariances_in_a_mirror_are_those_of_the_mirrored_pose() -> None:
    rng = np.random.default_rng(4)
    root = rng.normal(size=(72, 72))
    flip = np.diag([-1.0, 1.0, 1.0])
    mirrored = (flip @ POSES @ flip)[:, TWINS]
    # increments of the twin, reflected: axial vectors turn the other way about the two other axes
    of_mirror = np.kron(np.eye(24)[TWINS], np.diag([1.0, -1.0, -1.0])) @ root
    rest = REST[TWINS] * [-1, 1, 1]
    plain, other = (
        rotation_jacobian(POSES, REST) @ root,
        rotation_jacobian(mirrored, rest) @ of_mirror,
    )
    expected = other @ np.swapaxes(other, -1, -2)
    found = mirrored_rotation_covariance(plain @ np.swapaxes(plain, -1, -2))
    np.testing.assert_allclose(found, expected, atol=1e-9 * expected.max())


def test_the_mean_is_over_the_performances_that_show_the_moment() -> None:
    first, second = np.array([10.0, 20.0, 30.0]), np.array([14.0, 26.0, np.nan]) + 360
    inside = [np.array([True, True, True]), np.array([False, True, True])]
    mean = mean_curve([first, second], inside)
    np.testing.assert_array_equal(mean.n, [1, 2, 1])
    np.testing.assert_allclose(mean.mean_deg, [10, 23, 30])
    np.testing.assert_allclose(mean.sd_deg, [np.nan, np.sqrt(18), np.nan])
    np.testing.assert_allclose(without_steps(mean), [10, np.nan, np.nan])
