"""Knees and elbows do not bend backwards: a one-sided quadratic on the hinge angle."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState
from imocap_core.rotations import inverse_right_jacobian

# joint, axis-angle component, sign in which it flexes (SMPL's T-pose: y up, facing +z)
HINGES = (
    ("left_knee", 0, 1.0),
    ("right_knee", 0, 1.0),
    ("left_elbow", 1, -1.0),
    ("right_elbow", 1, 1.0),
)


@dataclass(frozen=True)
class HingeLimits:
    """``weight * max(0, -flexion - slack)^2`` for both knees and elbows, radians."""

    weight: float
    slack_rad: float = 0.1

    def _violation(self, state: MotionState) -> list[tuple[int, int, float, Tensor]]:
        parts = []
        for name, axis, sign in HINGES:
            joint = SMPL_JOINTS.index(name)
            flexion = sign * state.axis_angle[:, :, joint, axis]
            excess = (-flexion - self.slack_rad).clamp_min(0.0) * state.valid
            parts.append((joint, axis, sign, excess))
        return parts

    def of(self, v: int, frames: int) -> HingeLimits:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        parts = [excess.square().sum(1) for *_, excess in self._violation(state)]
        return self.weight * torch.stack(parts).sum(0)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Active only where violated."""
        for joint, axis, sign, excess in self._violation(state):
            theta = state.axis_angle[:, :, joint]
            row = -sign * inverse_right_jacobian(theta)[..., axis, :]
            row = row * (excess > 0)[..., None]
            span = slice(3 * joint, 3 * joint + 3)
            outer = row[..., :, None] * row[..., None, :]
            normal.diagonal[..., span, span] += self.weight * outer
            normal.gradient[..., span] += self.weight * row * excess[..., None]
