"""What keypoints do not tell comes from the prior's conditional given what they do tell."""

from __future__ import annotations

import numpy as np
import torch

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.gauss_newton import gauss_newton, linearise
from imocap_core.motion.prior import PosePrior, mixture
from imocap_core.motion.state import POSE, MotionState
from imocap_core.motion.terms import PoseCoupling, PosePriorTerm
from imocap_core.motion.terms.base import Term
from imocap_core.rotations import exp

BENT, HIDDEN = SMPL_JOINTS.index("left_elbow"), SMPL_JOINTS.index("left_wrist")
SPREAD_RAD, CORRELATION, MEAN_RAD = 0.3, 0.8, 0.1
ANGLE_RAD = 0.7


def prior_of_two() -> PosePrior:
    """Two joints turn about z with equal spread, correlated; all else stays near rest."""
    covariance = np.eye(69) * SPREAD_RAD**2
    a, b = (3 * (joint - 1) + 2 for joint in (BENT, HIDDEN))
    covariance[a, b] = covariance[b, a] = CORRELATION * SPREAD_RAD**2
    mean = np.zeros((1, 69))
    mean[0, [a, b]] = MEAN_RAD
    return mixture(mean, covariance[None], np.ones(1), np.ones(24), np.ones(24))


def terms_that_tell_one_joint() -> tuple[list[Term], MotionState]:
    rest = torch.eye(3, dtype=torch.float64).expand(1, 1, 24, 3, 3).clone()
    target = rest.clone()
    target[0, 0, BENT] = exp(torch.tensor([0.0, 0.0, ANGLE_RAD], dtype=torch.float64))
    hold = torch.zeros(1, 1, 24, dtype=torch.float64)
    hold[..., [0, BENT]] = 1e8
    start = MotionState.of(
        rest,
        torch.zeros(1, 1, 3, dtype=torch.float64),
        torch.zeros(1, 10, dtype=torch.float64),
        torch.ones(1, 1, dtype=torch.bool),
    )
    return [PosePriorTerm(prior_of_two(), 1.0), PoseCoupling(target, hold)], start


def test_a_hidden_joint_takes_its_conditional_mean() -> None:
    terms, start = terms_that_tell_one_joint()
    fitted = gauss_newton(
        terms, start, max_steps=50, relative_tolerance=1e-12, free_shape=False
    ).state
    turned = fitted.axis_angle[0, 0]
    expected = MEAN_RAD + CORRELATION * (ANGLE_RAD - MEAN_RAD)
    torch.testing.assert_close(
        turned[HIDDEN], torch.tensor([0.0, 0.0, expected]).to(turned), atol=1e-4, rtol=0
    )
    others = [k for k in range(1, 24) if k not in (BENT, HIDDEN)]
    assert turned[others].abs().max() < 1e-4


def test_its_claimed_spread_is_the_conditional_one() -> None:
    terms, start = terms_that_tell_one_joint()
    fitted = gauss_newton(
        terms, start, max_steps=50, relative_tolerance=1e-12, free_shape=False
    ).state
    H = linearise(terms, fitted).diagonal[0, 0, :POSE, :POSE]
    spread = torch.linalg.inv(H)[3 * HIDDEN + 2, 3 * HIDDEN + 2].sqrt()
    conditional = SPREAD_RAD * np.sqrt(1 - CORRELATION**2)
    np.testing.assert_allclose(float(spread), conditional, rtol=1e-3)
