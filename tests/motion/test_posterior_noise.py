"""The model's error: claims are never below the posterior, and turn with it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.motion.posterior_noise import (
    PLACE_SD_M,
    claimed_covariance_m2,
    claimed_rotation_sd,
    claimed_rotations_deg2,
)


def posterior() -> np.ndarray:
    roots = np.random.default_rng(0).normal(0, 0.02, (3, 24, 3, 3))
    return np.asarray(roots @ roots.swapaxes(-1, -2))


def test_claims_of_performances_are_never_below_the_posterior() -> None:
    given = posterior()
    claimed = claimed_covariance_m2(given, one_motion=False)
    assert np.linalg.eigvalsh(claimed - given).min() > -1e-12


def test_no_joint_of_one_motion_is_surer_than_its_place_in_the_body() -> None:
    claimed = claimed_covariance_m2(np.zeros((3, 24, 3, 3)), one_motion=True)
    np.testing.assert_allclose(claimed, np.broadcast_to(PLACE_SD_M**2 * np.eye(3), claimed.shape))


@pytest.mark.parametrize("one_motion", [False, True])
def test_lasting_errors_of_a_detector_are_left_of_one_motion_and_of_several(one_motion):
    given = posterior()
    claimed = claimed_covariance_m2(given, one_motion=one_motion, lasting_sd_m=0.01)
    several = claimed_covariance_m2(given, one_motion=False)
    np.testing.assert_allclose(claimed - several, np.broadcast_to(1e-4 * np.eye(3), given.shape))
    turned = claimed_rotations_deg2(given, one_motion=one_motion, lasting_sd_m=0.01)
    least = claimed_rotations_deg2(given, one_motion=False)
    assert np.linalg.eigvalsh(turned - least).min() > 0


def test_one_motion_is_claimed_with_smaller_errors_where_these_are_large() -> None:
    large = 100 * posterior()
    one, several = (claimed_covariance_m2(large, one_motion=x) for x in (True, False))
    assert np.linalg.eigvalsh(several).max() > np.linalg.eigvalsh(one).max()


@pytest.mark.parametrize("one_motion", [False, True])
def test_claims_turn_with_the_axes(one_motion: bool) -> None:
    given, turn = posterior(), Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix()
    turned = claimed_covariance_m2(turn @ given @ turn.T, one_motion=one_motion)
    claimed = claimed_covariance_m2(given, one_motion=one_motion)
    np.testing.assert_allclose(turned, turn @ claimed @ turn.T, atol=1e-15)


def test_a_camera_that_is_unknown_stays_unknown() -> None:
    assert np.isnan(claimed_rotation_sd(np.nan))
    assert claimed_rotation_sd(0.02) == pytest.approx(2 * claimed_rotation_sd(0.01))
    assert claimed_rotation_sd(0.01) >= 0.01
