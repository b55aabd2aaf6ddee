"""Soft limits of the joints: a one-sided quadratic beyond a range of axis-angle components."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms.joint_ranges import HINGE_RANGES, JOINT_RANGES, ComponentRange
from imocap_core.rotations import inverse_right_jacobian


@dataclass(frozen=True)
class JointLimits:
    """``weight * max(0, lower - slack - theta, theta - upper - slack)^2``, radians, summed over
    the components theta of ``ranges`` and over frames.

    The default ranges are those of the literature (`joint_ranges`). No fit uses them yet: they
    have not been measured on an action.
    """

    weight: float
    slack_rad: float = 0.1
    ranges: tuple[ComponentRange, ...] = JOINT_RANGES

    def of(self, v: int, frames: int) -> JointLimits:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return self.weight * self._excess(state).square().sum(-1).sum(0)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Active only where violated."""
        joints = sorted({r.joint for r in self.ranges})
        place = {joint: i for i, joint in enumerate(joints)}
        excess = state.axis_angle.new_zeros(*state.valid.shape, len(joints), 3)
        rows = [place[r.joint] for r in self.ranges], [r.component for r in self.ranges]
        excess[:, :, rows[0], rows[1]] = self._excess(state).movedim(0, -1)
        active = (excess != 0)[..., None]
        jacobian = inverse_right_jacobian(state.axis_angle[:, :, joints]) * active
        outer = (jacobian[..., :, None] * jacobian[..., None, :]).sum(-3)
        gradient = (self.weight * jacobian * excess[..., None]).sum(-2)
        device = state.trans.device
        first = torch.tensor(joints, device=device)[:, None] * 3
        unknowns = first + torch.arange(3, device=device)
        normal.diagonal[..., unknowns[:, :, None], unknowns[:, None, :]] += self.weight * outer
        normal.gradient[..., unknowns] += gradient

    def _excess(self, state: MotionState) -> Tensor:
        """(components, B, T) radians beyond the range: above > 0, below < 0, 0 within."""
        joints, components, lower, upper = zip(*self.ranges, strict=True)
        theta = state.axis_angle[:, :, joints, components].movedim(-1, 0).contiguous()
        low, high = (theta.new_tensor(bound)[:, None, None] for bound in (lower, upper))
        above = (theta - (high + self.slack_rad)).clamp_min(0.0)
        below = ((low - self.slack_rad) - theta).clamp_min(0.0)
        return (above - below) * state.valid


@dataclass(frozen=True)
class HingeLimits(JointLimits):
    """Knees and elbows do not bend backwards."""

    ranges: tuple[ComponentRange, ...] = HINGE_RANGES
