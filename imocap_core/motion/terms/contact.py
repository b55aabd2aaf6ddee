"""Contact and balance: feet on the ground do not slide, the centre of mass is above them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import maximum_filter1d
from torch import Tensor

from imocap_core.motion.normal import NormalEquations, add_product
from imocap_core.motion.state import POSE, Body, MotionState, MovedPoints
from imocap_core.motion.terms.base import isotropic, padded, pairs, pieces, running_mean
from imocap_core.robust import cauchy, geman_mcclure, geman_mcclure_weight

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


@dataclass(frozen=True)
class Balance:
    """Horizontal distance of the centre of mass from the middle of its support.

    Both are weighted means of the joints, whose weights are constant; so is gravity. Translation
    does not enter.

    Attributes:
        body: whose 24 joints.
        arm: (B, T, 24) weights of the centre of mass less those of the support's middle.
        whiten: (B, T, 2, 3) from an arm in metres to horizontal coordinates in standard deviations;
            0 where nothing is claimed.
        weight: cost of one standard deviation.
        scale: Cauchy scale, standard deviations.
    """

    body: Body
    arm: Float[Tensor, "B T 24"]
    whiten: Float[Tensor, "B T 2 3"]
    weight: float
    scale: float

    def of(self, v: int, frames: int) -> Balance:
        """One motion's frames."""
        row = slice(v, v + 1)
        return replace(self, arm=self.arm[row, :frames], whiten=self.whiten[row, :frames])

    def residual(self, xyz: Float[Tensor, "B T 24 3"]) -> Float[Tensor, "B T 2"]:
        """Horizontal arm of the centre of mass, in standard deviations."""
        return (self.whiten @ (self.arm[..., None] * xyz).sum(-2)[..., None])[..., 0]

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        squared = self.residual(self.body.positions(self.body.joints, state)).square().sum(-1)
        return self.weight * (cauchy(squared, self.scale)[0] * state.valid).sum(1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """The residual is linear in the joints, so its rows are the joints' derivatives, summed."""
        for frames in pieces(state.valid.shape[1]):
            points = self.body.derivatives(self.body.joints, state, frames)
            part = replace(self, arm=self.arm[:, frames], whiten=self.whiten[:, frames])
            part._add_piece(normal.of_frames(frames), points, state.valid[:, frames])

    def _add_piece(self, normal: NormalEquations, points: MovedPoints, valid: Tensor) -> None:
        residual = self.residual(points.xyz)
        weight = self.weight * cauchy(residual.square().sum(-1), self.scale)[1] * valid
        pose, shape = (
            self.whiten @ (self.arm[:, :, None] @ x.flatten(3)).view(*x.shape[:2], 3, -1)
            for x in (points.d_pose, points.d_beta)
        )
        count = shape.shape[-1]
        by_pose, by_shape = (weight[..., None, None] * x for x in (pose, shape))
        pulled = residual[..., None]
        add_product(normal.diagonal[..., :POSE, :POSE], pose, by_pose)
        normal.border[..., :POSE, :count] += by_pose.mT @ shape
        normal.corner[:, :count, :count] += (shape.mT @ by_shape).sum(1)
        normal.gradient[..., :POSE] += (by_pose.mT @ pulled)[..., 0]
        normal.corner_gradient[:, :count] += (by_shape.mT @ pulled)[..., 0].sum(1)


_ACROSS = 0.2  # sine of the angle between lines of sight at which balance counts half
_LEAST_SHARE = 0.1  # below it balance is left out
_HOLDS_S = 0.5  # what views show of a lean holds so long before and after


def share_of_balance(
    root_m: Float[np.ndarray, "N 3"],
    R: Float[np.ndarray, "M 3 3"],
    t_m: Float[np.ndarray, "M 3"],
    confidence: Float[np.ndarray, "M N"],
    fps: float,
) -> Float[np.ndarray, " N"]:
    """Share of each frame's balance that no view replaces, 0 where it is small.

    It is 1 / (1 + s / `_ACROSS`^2), s the sum over the videos of confidence times sin^2 of the
    angle to the line that most of them look along, the largest within half a second.

    Args:
        root_m: the body's, in the world; R, t_m: x_cam = R x_world + t of each video.
        confidence: of each video's match with each frame.
    """
    sight = root_m + np.einsum("mji,mj->mi", R, t_m)[:, None]
    sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
    moments = np.einsum("mn,mna,mnb->nab", confidence, sight, sight)
    across = np.linalg.eigvalsh(moments)[:, :2].sum(axis=1)
    share = 1 / (1 + maximum_filter1d(across, 2 * round(_HOLDS_S * fps) + 1) / _ACROSS**2)
    return np.where(share < _LEAST_SHARE, 0.0, share)
