"""Feet that stand, stand still."""

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.normal import NormalEquations, add_product
from imocap_core.motion.robust import geman_mcclure
from imocap_core.motion.state import MotionState

STANDING_S = 0.4


@dataclass(frozen=True)
class StandingFeet:
    """Speeds of ankles and balls of the feet, at a cost with a ceiling.

    A foot either stands or swings. Geman-McClure's loss draws slow feet to a stop and lets fast
    ones go. The state's axes must not move against the ground.

    Attributes:
        body: whose feet.
        weight: 1 / (m per frame)^2 of small speeds, one for all or (B, T-1, 4).
        scale: square root of the ceiling.
    """

    body: Body
    weight: float | Tensor
    scale: float

    def of(self, v: int, frames: int) -> Self:
        """One motion's feet."""
        if isinstance(self.weight, float):
            return self
        return replace(self, weight=self.weight[v : v + 1, : frames - 1])

    def _cost(self, step: Tensor) -> tuple[Tensor, Tensor]:
        return geman_mcclure(self.weight * step.square().sum(-1), self.scale)

    def cost(self, state: MotionState) -> Tensor:
        """(B,)."""
        feet = self.body.positions(self.body.feet, state).xyz
        return self._cost(_steps(feet, state.valid))[0].sum((1, 2))

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Rows of a pair of frames are those of the later minus those of the earlier one."""
        feet, frame, d_beta = state.once((self.body.feet, _moved), lambda: _moved(self.body, state))
        step = _steps(feet, state.valid)
        root = (self.weight * self._cost(step)[1]).sqrt()
        root = root * (state.valid[:, :-1] & state.valid[:, 1:])[..., None]
        residual = (step * root[..., None]).flatten(2)
        earlier, later = (_rows(x, root) for x in (-frame[:, :-1], frame[:, 1:]))
        shape = _rows(d_beta[:, 1:] - d_beta[:, :-1], root)
        count = shape.shape[-1]
        beside = torch.nn.functional.pad(root.square(), (0, 0, 1, 1))  # of the pairs a frame is in
        both = _rows(frame, (beside[:, :-1] + beside[:, 1:]).sqrt())
        add_product(normal.diagonal, both, both)
        add_product(normal.next1[:, :-1], earlier, later)
        for rows, frames in ((earlier, slice(None, -1)), (later, slice(1, None))):
            normal.gradient[:, frames] += (rows.mT @ residual[..., None])[..., 0]
            normal.border[:, frames, :, :count] += rows.mT @ shape
        flat, pull = shape.flatten(1, 2), residual.flatten(1)[..., None]
        normal.corner[:, :count, :count] += flat.mT @ flat
        normal.corner_gradient[:, :count] += (flat.mT @ pull)[..., 0]


def standing_share(body: Body, state: MotionState, fps: float, *, speed_m_s: float) -> Tensor:
    """(B, T-1, 4) in (0, 1]: whether each foot stands between a frame and the next.

    Geman-McClure weight of its mean speed over `STANDING_S`, so that jitter lifts no foot;
    ``speed_m_s`` counts a quarter.
    """
    step = _steps(body.positions(body.feet, state).xyz, state.valid)
    half = max(1, round(STANDING_S * fps / 2))
    padded = torch.nn.functional.pad(step.flatten(2).mT, (half, half), mode="replicate")
    mean = padded.unfold(-1, 2 * half + 1, 1).mean(-1).mT.unflatten(-1, (-1, 3))
    speed = fps * mean.norm(dim=-1)
    return 1 / (1 + (speed / speed_m_s).square()).square()


def _steps(feet: Tensor, valid: Tensor) -> Tensor:
    """(B, T-1, F, 3) movement from each frame to the next, 0 where one of them is padding."""
    both = (valid[:, :-1] & valid[:, 1:])[..., None, None]
    return (feet[:, 1:] - feet[:, :-1]) * both


def _moved(body: Body, state: MotionState) -> tuple[Tensor, Tensor, Tensor]:
    """Feet (B, T, F, 3) and their derivatives by a frame's unknowns and by the shape."""
    points = body.derivatives(body.feet, state)
    assert points.d_pose is not None
    assert points.d_beta is not None
    moves = torch.eye(3).to(points.xyz).expand(*points.xyz.shape, 3)
    return points.xyz, torch.cat([points.d_pose, moves], -1), points.d_beta


def _rows(derivative: Tensor, root: Tensor) -> Tensor:
    return (derivative * root[..., None, None]).flatten(2, 3)
