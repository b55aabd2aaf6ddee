"""Balance of monocular fits: one view hardly shows how far a body leans to or from the camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.body.mass import JOINT_MASS_SHARES
from imocap_core.camera.gravity import FilmedBody, estimate_up
from imocap_core.camera.tilt_evidence import (
    DYNAMIC_S,
    LIMB_SHARES,
    SWAY_M,
    LevelPrior,
    perpendicular,
    support_of,
    support_shares,
    support_under,
)
from imocap_core.motion.kinematics import Body
from imocap_core.motion.observations import Observation, padded
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Balance, Term
from imocap_core.params import FitParams

REACH = 0.1  # further deviation, as a share of the height: people do lean
SCALE_SIGMAS = 2.0  # beyond it the cost grows only logarithmically: people also fall and jump


def balance_terms(
    body: Body, state: MotionState, observations: Sequence[Observation], weights: FitParams
) -> list[Term]:
    """Balance over the limbs that support each motion, under the up that its video tells.

    Both are those of ``state`` and constant in the term. It is for an action's only video: several
    tell together how far a body leans, and who balances on one leg would be drawn off the truth
    (`docs/motion.md`).
    """
    if weights.balance == 0:
        return []
    level = LevelPrior(
        weights.camera_roll_deg, weights.camera_pitch_deg, weights.camera_pitch_down_deg
    )
    joints = body.positions(body.joints, state).xyz.detach().cpu().numpy()
    arms, whitening = [], []
    for x, o in zip(joints, observations, strict=True):
        filmed = FilmedBody(x[: len(o.xy_px)], o.fps, o.R_mean_from_first)
        arm, whiten = arms_above_support(filmed, estimate_up([filmed], level).up)
        arms.append(arm)
        whitening.append(whiten)
    rows = padded(arms, state.trans), padded(whitening, state.trans)
    return [Balance(body, *rows, weights.balance, SCALE_SIGMAS)]


def arms_above_support(
    filmed: FilmedBody, up: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "T 24"], Float[np.ndarray, "T 2 3"]]:
    """Joint weights of the centre of mass less the support's middle, and the whitening of that arm:
    (2, 3) to its horizontal coordinates in standard deviations."""
    support = support_of(filmed.joints, filmed.fps, len(filmed.joints))
    middle, spread = (x[0] for x in support_under(up[None], support))
    share = support_shares(up[None], support)[0]
    height = (support.centre - middle) @ up
    free = SWAY_M**2 + (REACH * height) ** 2 + (DYNAMIC_S * support.speed_m_s) ** 2
    axes = np.stack([axis[0] for axis in perpendicular(up[None])])
    covariance = axes @ spread @ axes.T + free[:, None, None] * np.eye(2)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance)) @ axes
    return JOINT_MASS_SHARES - share @ LIMB_SHARES, whiten
