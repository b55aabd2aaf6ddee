"""Motion retargeting: a body model fitted to captured joints, so that they can be rendered.

The body's joints are the ground truth of the rendered videos; they differ from the captured ones
where its bones are longer or shorter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
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
from imocap_core.rotations import project as nearest_rotation

# Standard deviation (metres) of a captured joint from the body's joint of the same name.
SPREAD_M = {"hip": 0.02, "shoulder": 0.02, "neck": 0.03, "head": 0.05}
LIMB_SPREAD_M = 0.01
TURN_SPREAD_RAD = 0.8  # standard deviation of rotations about the rest pose,
END_SPREAD_RAD = 0.3  # and of joints at the ends of limbs
ENDS = ("left_ankle", "right_ankle", "left_foot", "right_foot", "left_hand", "right_hand")
ROBUST_SIGMA = 10.0
MAX_STEPS = 15


@dataclass(frozen=True)
class RetargetedMotion:
    """Local rotations and translation of a body, in the axes of the captured joints, metres."""

    R_local: Float[np.ndarray, "T 24 3 3"]
    transl: Float[np.ndarray, "T 3"]


def retarget(
    model: Model, clips: Sequence[Float[np.ndarray, "_ 14 3"]]
) -> tuple[Float[np.ndarray, "10"], list[RetargetedMotion]]:
    """Shape and motions of one body, fitted to all clips of a performer.

    Args:
        clips: captured joints (T, 14, 3) in metres, in the order of EVAL_14.

    Returns:
        The shape coefficients, and the motion of each clip.
    """
    body = Body.of(model, "smpl24")
    joints, weight, valid = _stacked(clips)
    frames = valid.shape[1]
    eye = torch.eye(3, dtype=torch.float64).expand(len(clips), frames, 24, 3, 3).contiguous()
    zeros = torch.zeros(len(clips), frames, 3, dtype=torch.float64)
    start = MotionState.of(eye, zeros, zeros.new_zeros(len(clips), 10), valid)
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
    motions = []
    for v, clip in enumerate(clips):
        rows = slice(0, len(clip))
        R_local, target, w = fitted.R_local[v, rows].clone(), joints[v, rows], weight[v, rows]
        share = (w / w.sum(-1, keepdim=True))[..., None]
        nowhere = R_local.new_zeros(len(clip), 3)
        joints_now = shaped.pose(R_local, nowhere).joints
        R_local[:, 0] = _best_rotation(joints_now, target, share) @ R_local[:, 0]
        transl = (share * (target - shaped.pose(R_local, nowhere).joints)).sum(1)
        motions.append(RetargetedMotion(R_local.numpy(), transl.numpy()))
    return betas.numpy(), motions


def _best_rotation(
    joints: Float[Tensor, "T J 3"], target: Float[Tensor, "T J 3"], share: Float[Tensor, "T J 1"]
) -> Float[Tensor, "T 3 3"]:
    """Weighted least-squares rotation of joints onto the target, about the weighted means."""
    a, b = (x - (share * x).sum(1, keepdim=True) for x in (joints, target))
    return nearest_rotation(torch.einsum("tki,tkj->tij", share * b, a))


def _stacked(
    clips: Sequence[Float[np.ndarray, "_ 14 3"]],
) -> tuple[Float[Tensor, "B T 24 3"], Float[Tensor, "B T 24"], Bool[Tensor, "B T"]]:
    """Padded joints, weights in 1/m^2, and which frames exist."""
    longest = max(len(clip) for clip in clips)
    joints = torch.zeros(len(clips), longest, 24, 3, dtype=torch.float64)
    weight = torch.zeros(len(clips), longest, 24, dtype=torch.float64)
    valid = torch.zeros(len(clips), longest, dtype=torch.bool)
    for row, clip in enumerate(clips):
        valid[row, : len(clip)] = True
        for column, name in enumerate(EVAL_14):
            k = SMPL_JOINTS.index(name)
            spread = SPREAD_M.get(name.split("_")[-1], LIMB_SPREAD_M)
            joints[row, : len(clip), k] = torch.as_tensor(clip[:, column]).double()
            weight[row, : len(clip), k] = spread**-2
    return joints, weight, valid


def _rest_prior() -> PosePrior:
    """A wide Gaussian about the rest pose: determines what joint positions do not (twists)."""
    spread = np.full(69, TURN_SPREAD_RAD)
    for name in ENDS:
        first = 3 * (SMPL_JOINTS.index(name) - 1)
        spread[first : first + 3] = END_SPREAD_RAD
    ones = np.ones(24)
    return mixture(np.zeros((1, 69)), np.diag(spread**2)[None], np.ones(1), ones, ones)
