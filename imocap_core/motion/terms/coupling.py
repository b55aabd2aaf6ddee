"""The coupling between videos (Eq. 8), and joints known in 3D as evidence of articulation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.body.points import PointSet
from imocap_core.motion.normal import NormalEquations, add_product
from imocap_core.motion.state import POSE, Body, MotionState, MovedPoints
from imocap_core.motion.terms.base import pieces
from imocap_core.robust import geman_mcclure
from imocap_core.rotations import log
from imocap_core.rotations import project as nearest_rotation


@dataclass(frozen=True)
class PoseCoupling:
    """``lambda_r1 |theta - Z|^2`` with the difference taken on the rotation manifold.

    Attributes:
        target: (B, T, 24, 3, 3) the low-rank poses Z, in each motion's own axes.
        weight: (B, T, 24) per joint, 1/rad^2; 0 leaves a joint free.
    """

    target: Float[Tensor, "B T 24 3 3"]
    weight: Float[Tensor, "B T 24"]

    def _residual(self, state: MotionState) -> Tensor:
        return state.cached((self,), lambda: log(self.target.mT @ state.R_local))

    def of(self, v: int, frames: int) -> PoseCoupling:
        """One motion's target."""
        return replace(
            self, target=self.target[v : v + 1, :frames], weight=self.weight[v : v + 1, :frames]
        )

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return (self.weight * self._residual(state).square().sum(-1)).sum((1, 2))

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """The gradient is exactly the residual (the rotation keeps its own axis)."""
        weight = self.weight[..., None].expand(*self.weight.shape, 3)
        normal.gradient[..., :POSE] += (weight * self._residual(state)).flatten(2)
        torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)[..., :POSE] += weight.flatten(2)


@dataclass(frozen=True)
class PathCoupling:
    """``lambda_r2 |gamma - Y|^2``.

    Attributes:
        target: (B, T, 3) the low-rank root paths Y in each motion's own axes, metres.
        weight: (B, T) 1/m^2.
    """

    target: Float[Tensor, "B T 3"]
    weight: Float[Tensor, "B T"]

    def of(self, v: int, frames: int) -> PathCoupling:
        """One motion's target."""
        return replace(
            self, target=self.target[v : v + 1, :frames], weight=self.weight[v : v + 1, :frames]
        )

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return (self.weight * (state.trans - self.target).square().sum(-1)).sum(1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Linear."""
        normal.gradient[..., POSE:] += self.weight[..., None] * (state.trans - self.target)
        torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)[..., POSE:] += self.weight[..., None]


@dataclass(frozen=True)
class JointEvidence:
    """Distance of the body's joints to estimated ones, after the best rotation per frame.

    The rotation is solved at each linearisation, so the evidence constrains articulation only and
    cannot pull the root orientation, which drifts in every estimator.

    Attributes:
        body: whose points are compared.
        joints: (B, T, J, 3) metres, any axes, centred on the weighted mean of each frame; or
            (B, T, E, J, 3): E estimates of the same motion.
        weight: (B, T, J) or (B, T, E, J) 1/m^2, 0 for missing joints.
        scale: Geman-McClure scale in units of the estimator's standard deviation.
        of_keypoints: whether the J are the body's keypoints, not its 24 joints.
    """

    body: Body
    joints: Float[Tensor, "B T *E J 3"]
    weight: Float[Tensor, "B T *E J"]
    scale: float
    of_keypoints: bool = False

    @property
    def _points(self) -> PointSet:
        return self.body.keypoints if self.of_keypoints else self.body.joints

    def residual(self, xyz: Float[Tensor, "B T J 3"]) -> Float[Tensor, "B T *E J 3"]:
        """Body minus rotated estimate, both centred."""
        xyz = xyz if self.joints.ndim == xyz.ndim else xyz[:, :, None]
        centred = xyz - self._centre(xyz)
        target = self.joints - self._centre(self.joints)
        correlation = (self.weight[..., None] * centred).mT @ target
        eye = torch.eye(3, dtype=xyz.dtype, device=xyz.device)
        empty = (self.weight.sum(-1) == 0)[..., None, None]
        R = nearest_rotation(torch.where(empty, eye, correlation).detach())
        return centred - target @ R.mT

    def _centre(self, xyz: Tensor) -> Tensor:
        return (self._share(self.weight)[..., None] * xyz).sum(-2, keepdim=True)

    def _share(self, weight: Tensor) -> Tensor:
        return weight / weight.sum(-1, keepdim=True).clamp_min(1e-12)

    def of(self, v: int, frames: int) -> JointEvidence:
        """One motion's joints."""
        row = slice(v, v + 1)
        return replace(self, joints=self.joints[row, :frames], weight=self.weight[row, :frames])

    def _residual_at(self, state: MotionState) -> Tensor:
        """The residual; the cost needs it, and so do the equations of the next step."""
        return state.cached(
            (self,), lambda: self.residual(self.body.positions(self._points, state))
        )

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        squared = self.weight * self._residual_at(state).square().sum(-1)
        return geman_mcclure(squared, self.scale)[0].flatten(1).sum(1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """The rotation and the centre are constant; translation does not enter.

        With weights w and shares s, centring turns the joints' weights into the matrix
        ``diag(w) - w s^T - s w^T + (sum w) s s^T``; summed over estimates, it is multiplied with
        the Jacobian once.
        """
        given = (self.weight > 0).flatten(0, -2).any(0)  # the others need no equations
        residual = self._residual_at(state)
        for frames in pieces(state.valid.shape[1]):
            points = self.body.derivatives(self._points, state, frames)
            part = replace(self, joints=self.joints[:, frames], weight=self.weight[:, frames])
            part._add_piece(normal.of_frames(frames), points, residual[:, frames], given)

    def _add_piece(
        self, normal: NormalEquations, points: MovedPoints, residual: Tensor, given: Tensor
    ) -> None:
        pose, shape = (x[:, :, given] for x in (points.d_pose, points.d_beta))
        metric, pull = self._metric(residual, given)
        by_pose, by_shape = (
            (metric @ x.flatten(3)).unflatten(-1, (3, -1)).flatten(2, 3) for x in (pose, shape)
        )
        pose, shape = pose.flatten(2, 3), shape.flatten(2, 3)
        count, pulled = shape.shape[-1], pull.flatten(2)[..., None]
        add_product(normal.diagonal[..., :POSE, :POSE], pose, by_pose)
        normal.border[..., :POSE, :count] += by_pose.mT @ shape
        normal.corner[:, :count, :count] += (shape.mT @ by_shape).sum(1)
        normal.gradient[..., :POSE] += (pose.mT @ pulled)[..., 0]
        normal.corner_gradient[:, :count] += (shape.mT @ pulled)[..., 0].sum(1)

    def _metric(self, residual: Tensor, given: Tensor) -> tuple[Tensor, Tensor]:
        """Weight matrix of the G given joints, (B, T, G, G), and their gradient (B, T, G, 3)."""
        squared = self.weight * residual.square().sum(-1)
        trust = self.weight * geman_mcclure(squared, self.scale)[1]
        weight, trust, residual = (
            x if self.joints.ndim == 5 else x[:, :, None]
            for x in (self.weight[..., given], trust[..., given], residual[..., given, :])
        )
        share = self._share(weight)  # (B, T, E, G)
        total = trust.sum(-1, keepdim=True)
        crossed = (trust - total / 2 * share).mT @ share
        metric = torch.diag_embed(trust.sum(2)) - crossed - crossed.mT
        pull = trust[..., None] * residual
        pull = pull - share[..., None] * pull.sum(-2, keepdim=True)
        return metric, pull.sum(2)
