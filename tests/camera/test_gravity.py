"""Up is where bodies balance, feet are planted on a plane, and cameras are held level."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.body.mass import JOINT_MASS_SHARES, centre_of_mass
from imocap_core.camera.gravity import FilmedBody, estimate_up
from tests.camera.standing import (
    FPS,
    LEVEL_CAMERA,
    PRIOR,
    angle_deg,
    filmed,
    standing,
    turned,
    walking,
)

Y_UP = np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize("joints", [standing(), walking()], ids=["standing", "walking"])
@pytest.mark.parametrize("seed", range(3))
def test_up_turns_with_the_world(joints, seed: int) -> None:
    rotation = Rotation.random(random_state=seed)
    estimate = estimate_up([filmed(joints, rotation)], PRIOR)
    assert angle_deg(estimate.up, rotation.apply(Y_UP)) < 3.0
    assert 0.5 < estimate.sd_deg < 5.0


def test_cameras_without_a_body_tell_it_by_how_they_are_held() -> None:
    nobody = np.full((10, 24, 3), np.nan)
    alone = estimate_up([FilmedBody(nobody, FPS, LEVEL_CAMERA)], PRIOR)
    pitch = Rotation.from_euler("x", PRIOR.pitch_down_deg, degrees=True)
    assert angle_deg(alone.up, pitch.apply(Y_UP)) < 1.0
    together = estimate_up([FilmedBody(nobody, FPS, LEVEL_CAMERA)] * 4, PRIOR)
    assert together.sd_deg < 0.7 * alone.sd_deg
    assert estimate_up([filmed(standing(), Rotation.identity())], PRIOR).sd_deg < alone.sd_deg


@pytest.mark.parametrize("pitch_deg", [-10.0, 0.0, 20.0])
def test_a_body_shows_the_pitch_of_its_camera(pitch_deg: float) -> None:
    camera = Rotation.from_euler("x", pitch_deg, degrees=True).as_matrix() @ LEVEL_CAMERA
    estimate = estimate_up([filmed(walking(), Rotation.identity(), camera)], PRIOR)
    assert angle_deg(estimate.up, Y_UP) < 4.0


@pytest.mark.parametrize("lean_deg", [-40, 40])
def test_a_motion_that_leans_to_or_from_the_camera_is_wrong_rather_than_its_camera(
    lean_deg: int,
) -> None:
    leaning = turned(standing(), Rotation.from_euler("x", lean_deg, degrees=True))
    estimate = estimate_up([FilmedBody(leaning, FPS, LEVEL_CAMERA)], PRIOR)
    assert angle_deg(estimate.up, Y_UP) < 15.0


@pytest.mark.parametrize("roll_deg", [-25, 25])
def test_a_motion_that_leans_in_the_picture_shows_the_roll_of_its_camera(roll_deg: int) -> None:
    camera = Rotation.from_euler("z", roll_deg, degrees=True).as_matrix() @ LEVEL_CAMERA
    estimate = estimate_up([FilmedBody(standing(), FPS, camera)], PRIOR)
    assert angle_deg(estimate.up, Y_UP) < 5.0


def test_frames_without_all_joints_are_left_out() -> None:
    joints = standing().copy()
    joints[::3, 5] = np.nan
    assert np.isfinite(estimate_up([filmed(joints, Rotation.identity())], PRIOR).up).all()
    assert np.isfinite(estimate_up([filmed(joints[1:2], Rotation.identity())], PRIOR).up).all()


def test_the_centre_of_mass_is_the_hips_height_of_a_standing_body_and_moves_with_it() -> None:
    np.testing.assert_allclose(JOINT_MASS_SHARES.sum(), 1.0)
    joints = standing()[-1]
    centre = centre_of_mass(joints)
    assert 0.9 < centre[1] < 1.05
    assert abs(centre[0]) < 0.01
    turn, shift = Rotation.random(random_state=0), np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(
        centre_of_mass(turn.apply(joints) + shift), turn.apply(centre) + shift, atol=1e-12
    )
