"""Contact: feet on the ground do not slide."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms.base import isotropic, padded, pairs, running_mean
from imocap_core.robust import geman_mcclure, geman_mcclure_weight

CONTACT_WINDOW_S = 0.4


@dataclass(frozen=True)
class FootContact:
    """Speeds of ankles and balls of the feet, at a cost with a ceiling.

    A foot is in contact or swings. The Geman-McClure loss pulls slow feet to a stop and leaves fast
    ones free. The state's axes must not move against the ground.

    Attributes:
        body: whose feet.
        weight: 1 / (m per frame)^2 of small speeds, one for all or (B, T-1, 4).
        scale: square root of the ceiling.
    """

    body: Body
    weight: float | Float[Tensor, "B steps 4"]
    scale: float

    def of(self, v: int, frames: int) -> FootContact:
        """One motion's feet."""
        if isinstance(self.weight, float):
            return self
        return replace(self, weight=self.weight[v : v + 1, : frames - 1])

    def _cost(self, step: Tensor) -> tuple[Tensor, Tensor]:
        return geman_mcclure(self.weight * step.square().sum(-1), self.scale)

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        feet = self.body.positions(self.body.feet, state)
        return self._cost(_steps(feet, state.valid))[0].sum((1, 2))

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """A step is the later frame's foot minus the earlier one's, so with feet's derivatives J
        and a pair's weights W a frame gets ``J^T W J`` of both its pairs, and a pair
        ``-J^T W J'``."""
        points = self.body.derivatives(self.body.feet, state)
        step = _steps(points.xyz, state.valid)
        weight = self.weight * self._cost(step)[1] * pairs(state.valid)[..., None]  # (B, T-1, 4)
        of_frame = isotropic(padded(weight, 0, 1) + padded(weight, 1, 0))
        points.add_products(normal.diagonal, points, of_frame)
        first, later = points.of_frames(slice(-1)), points.of_frames(slice(1, None))
        first.add_products(normal.next1[:, :-1], later, isotropic(-weight))
        rows = torch.cat([later.d_beta - first.d_beta, step[..., None]], -1)
        pull = weight[..., None, None] * rows
        ends = padded(pull, 1, 0) - padded(pull, 0, 1)
        normal.add_columns(points.pulled(ends), rows.flatten(1, 3), pull.flatten(1, 3))


def foot_contact_share(
    body: Body, state: MotionState, fps: float, *, speed_m_s: float
) -> Float[Tensor, "B steps 4"]:
    """Weight in (0, 1] of each foot's contact between a frame and the next (T - 1 steps).

    Geman-McClure weight of its mean speed over `CONTACT_WINDOW_S`, so that jitter ends no contact;
    ``speed_m_s`` counts a quarter.
    """
    step = _steps(body.positions(body.feet, state), state.valid)
    return contact_share(step, fps, speed_m_s=speed_m_s)


def contact_share(
    step: Float[Tensor, "B steps F 3"], fps: float, *, speed_m_s: float
) -> Float[Tensor, "B steps F"]:
    """The same from the points' movements from each frame to the next, metres."""
    half = max(1, round(CONTACT_WINDOW_S * fps / 2))
    mean = running_mean(step.flatten(2).mT, half).mT.unflatten(-1, (-1, 3))
    speed = fps * mean.norm(dim=-1)
    return geman_mcclure_weight(speed, speed_m_s)


def _steps(feet: Tensor, valid: Tensor) -> Tensor:
    """(B, T-1, F, 3) movement from each frame to the next, 0 where one of them is padding."""
    return (feet[:, 1:] - feet[:, :-1]) * pairs(valid)[..., None, None]
