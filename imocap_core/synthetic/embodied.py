"""Captured joints put on a body, so that they can be filmed.

The body's own joints are the truth of what is filmed afterwards; they miss the captured ones by
what its bones are longer or shorter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imocap_core.body.model import Model
from imocap_core.conventions import EVAL_14, SMPL_JOINTS
from imocap_core.motion.kinematics import Body
from imocap_core.motion.prior import PosePrior, mixture
from imocap_core.motion.solver.gauss_newton import gauss_newton
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import (
    HingeLimits,
    JointEvidence,
    PosePriorTerm,
    PoseSmoothness,
    ShapePrior,
    Term,
)
from imocap_core.render.arrays import Floats
from imocap_core.rotations import project as nearest_rotation

# How far (standard deviation, metres) a captured joint is from "the same place" of the body.
SPREAD_M = {"hip": 0.02, "shoulder": 0.02, "neck": 0.03, "head": 0.05}
LIMB_SPREAD_M = 0.01
TURN_SPREAD_RAD = 0.8  # about rest, of what joints alone do not tell
END_SPREAD_RAD = 0.3
ENDS = ("left_ankle", "right_ankle", "left_foot", "right_foot", "left_hand", "right_hand")
ROBUST_SIGMA = 10.0
MAX_STEPS = 15


@dataclass(frozen=True)
class Embodied:
    """R_local (T, 24, 3, 3) and transl (T, 3) of a body, in the axes of the captured joints."""

    R_local: Floats
    transl: Floats


def embody(model: Model, takes: Sequence[Floats]) -> tuple[Floats, list[Embodied]]:
    """One body that performs all takes.

    Args:
        takes: joints (T_v, 14, 3) metres of one performer, in the order of EVAL_14.

    Returns:
        The performer's shape, coefficients (10,), and the motion of each take.
    """
    body = Body.of(model, "smpl24")
    joints, weight, valid = _stacked(takes)
    frames = valid.shape[1]
    eye = torch.eye(3, dtype=torch.float64).expand(len(takes), frames, 24, 3, 3).contiguous()
    zeros = torch.zeros(len(takes), frames, 3, dtype=torch.float64)
    start = MotionState.of(eye, zeros, zeros.new_zeros(len(takes), 10), valid)
    ones = torch.ones(24, dtype=torch.float64)
    terms: list[Term] = [
        JointEvidence(body, joints, weight, ROBUST_SIGMA),
        PosePriorTerm(_rest_prior(), 0.05),
        ShapePrior(1.0),
        HingeLimits(100.0),
        PoseSmoothness(10.0 * ones, 0.0 * ones, 1.0),
    ]
    fitted = gauss_newton(terms, start, max_steps=MAX_STEPS, relative_tolerance=3e-3).state
    betas = fitted.betas.mean(0)
    shaped = model.shape(betas)
    found = []
    for v, take in enumerate(takes):
        rows = slice(0, len(take))
        R_local, target, w = fitted.R_local[v, rows].clone(), joints[v, rows], weight[v, rows]
        share = (w / w.sum(-1, keepdim=True))[..., None]
        nowhere = R_local.new_zeros(len(take), 3)
        R_local[:, 0] = _turn(shaped.pose(R_local, nowhere).joints, target, share) @ R_local[:, 0]
        transl = (share * (target - shaped.pose(R_local, nowhere).joints)).sum(1)
        found.append(Embodied(R_local.numpy(), transl.numpy()))
    return betas.numpy(), found


def _turn(joints: Tensor, target: Tensor, share: Tensor) -> Tensor:
    """The rotation (T, 3, 3) about the weighted means that brings joints (T, 24, 3) nearest."""
    a, b = (x - (share * x).sum(1, keepdim=True) for x in (joints, target))
    return nearest_rotation(torch.einsum("tki,tkj->tij", share * b, a))


def _stacked(takes: Sequence[Floats]) -> tuple[Tensor, Tensor, Tensor]:
    """Joints (B, T, 24, 3), weights (B, T, 24) in 1/m^2, which frames there are (B, T)."""
    longest = max(len(take) for take in takes)
    joints = torch.zeros(len(takes), longest, 24, 3, dtype=torch.float64)
    weight = torch.zeros(len(takes), longest, 24, dtype=torch.float64)
    valid = torch.zeros(len(takes), longest, dtype=torch.bool)
    for row, take in enumerate(takes):
        valid[row, : len(take)] = True
        for column, name in enumerate(EVAL_14):
            k = SMPL_JOINTS.index(name)
            spread = SPREAD_M.get(name.split("_")[-1], LIMB_SPREAD_M)
            joints[row, : len(take), k] = torch.as_tensor(take[:, column]).double()
            weight[row, : len(take), k] = spread**-2
    return joints, weight, valid


def _rest_prior() -> PosePrior:
    """A wide Gaussian about the rest pose: holds what joints alone do not tell (twists)."""
    spread = np.full(69, TURN_SPREAD_RAD)
    for name in ENDS:
        at = 3 * (SMPL_JOINTS.index(name) - 1)
        spread[at : at + 3] = END_SPREAD_RAD
    ones = np.ones(24)
    return mixture(np.zeros((1, 69)), np.diag(spread**2)[None], np.ones(1), ones, ones)
