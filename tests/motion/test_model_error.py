"""Claimed covariances: the posterior's, enlarged, and the misfit of each kind of joint."""

import numpy as np
import pytest

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.posterior.model_error import (
    MISFIT_MM,
    claimed_covariance_m2,
    claimed_rotation_sd,
)


def posterior(seed: int) -> np.ndarray:
    """Covariances (3, 24, 3, 3), square metres."""
    root = 0.02 * np.random.default_rng(seed).normal(size=(3, 24, 3, 3))
    return root @ root.swapaxes(-1, -2)


def test_claims_exceed_the_posterior_in_every_direction() -> None:
    given = posterior(0)
    least = np.linalg.eigvalsh(claimed_covariance_m2(given) - given)[..., 0]
    assert (least > -1e-12).all()


def test_claims_are_the_same_in_any_axes() -> None:
    given, turn = posterior(1), np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turned = claimed_covariance_m2(turn @ given @ turn.T)
    np.testing.assert_allclose(turned, turn @ claimed_covariance_m2(given) @ turn.T, atol=1e-15)


def test_certain_joints_keep_the_misfit_of_their_kind_on_both_sides() -> None:
    certain = claimed_covariance_m2(np.zeros((1, 24, 3, 3)))[0]
    for kind, size_mm in MISFIT_MM.items():
        for side in ("left", "right"):
            joint = certain[SMPL_JOINTS.index(f"{side}_{kind}")]
            np.testing.assert_allclose(joint, (1e-3 * size_mm) ** 2 * np.eye(3))
    toes, ankle = (certain[SMPL_JOINTS.index(f"left_{name}")] for name in ("foot", "ankle"))
    np.testing.assert_array_equal(toes, ankle)


def test_what_is_unknown_stays_unknown() -> None:
    given = posterior(3)
    given[1, 5] = np.nan
    claimed = claimed_covariance_m2(given)
    assert np.isnan(claimed[1, 5]).all()
    assert np.isfinite(np.delete(claimed[1], 5, axis=0)).all()
    assert np.isnan(claimed_rotation_sd(np.nan))
    assert claimed_rotation_sd(0.0) == 0.0


def test_twice_the_deviation_of_a_camera_is_claimed_twice() -> None:
    assert claimed_rotation_sd(0.02) == pytest.approx(2 * claimed_rotation_sd(0.01))
    assert claimed_rotation_sd(0.01) >= 0.01
