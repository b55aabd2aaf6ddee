"""A monocular estimator's 3D joints as evidence of articulation."""

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.robust import geman_mcclure
from imocap_core.motion.state import POSE, MotionState
from imocap_core.rotations import project as nearest_rotation


@dataclass(frozen=True)
class JointEvidence:
    """Distance of the body's joints to estimated ones, after the best rotation per frame.

    The rotation is found anew at each linearisation, so the evidence speaks of articulation
    only and cannot pull the root orientation (method note C: it drifts in every estimator).

    Attributes:
        body: whose 24 joints are compared.
        joints: (B, T, 24, 3) metres, any axes, centred on the weighted mean of each frame.
        weight: (B, T, 24) 1/m^2, 0 for joints the estimator does not give.
        scale: Geman-McClure scale in units of the estimator's standard deviation.
    """

    body: Body
    joints: Tensor
    weight: Tensor
    scale: float

    def residual(self, xyz: Tensor) -> Tensor:
        """(B, T, 24, 3) body minus rotated estimate, both centred."""
        centred = xyz - self._centre(xyz)
        target = self.joints - self._centre(self.joints)
        correlation = torch.einsum("btk,btki,btkj->btij", self.weight, centred, target)
        eye = torch.eye(3, dtype=xyz.dtype, device=xyz.device)
        empty = (self.weight.sum(-1) == 0)[..., None, None]
        R = nearest_rotation(torch.where(empty, eye, correlation).detach())
        return centred - torch.einsum("btij,btkj->btki", R, target)

    def _centre(self, xyz: Tensor) -> Tensor:
        share = self.weight / self.weight.sum(-1, keepdim=True).clamp_min(1e-12)
        return (share[..., None] * xyz).sum(-2, keepdim=True)

    def of(self, v: int, frames: int) -> Self:
        """One motion's joints."""
        own = slice(v, v + 1)
        return replace(self, joints=self.joints[own, :frames], weight=self.weight[own, :frames])

    def cost(self, state: MotionState) -> Tensor:
        """(B,)."""
        residual = self.residual(self.body.positions(self.body.joints, state).xyz)
        squared = self.weight * residual.square().sum(-1)
        return geman_mcclure(squared, self.scale)[0].sum((1, 2))

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """The rotation and the centre are held; translation is not touched."""
        points = self.body.derivatives(self.body.joints, state)
        assert points.d_pose is not None
        assert points.d_beta is not None
        residual = self.residual(points.xyz)
        squared = self.weight * residual.square().sum(-1)
        root = (self.weight * geman_mcclure(squared, self.scale)[1]).sqrt()
        given = (self.weight > 0).flatten(0, 1).any(0)  # joints that no estimate gives cost nothing
        d_xyz = torch.cat([points.d_pose[:, :, given], points.d_beta[:, :, given]], -1)
        weight, root, residual = (x[:, :, given] for x in (self.weight, root, residual))
        share = weight / weight.sum(-1, keepdim=True).clamp_min(1e-12)
        eye = torch.eye(share.shape[-1], dtype=share.dtype, device=share.device)
        centring = (eye - share[..., None, :]) * root[..., None]
        rows = (centring @ d_xyz.flatten(3)).unflatten(-1, (3, -1)).flatten(2, 3)
        error = (residual * root[..., None]).flatten(2)
        full = rows.transpose(-1, -2) @ rows
        gradient = (rows.transpose(-1, -2) @ error[..., None])[..., 0]
        normal.diagonal[..., :POSE, :POSE] += full[..., :POSE, :POSE]
        count = state.betas.shape[1]
        normal.border[..., :POSE, :count] += full[..., :POSE, POSE:]
        normal.corner[:, :count, :count] += full[..., POSE:, POSE:].sum(1)
        normal.gradient[..., :POSE] += gradient[..., :POSE]
        normal.corner_gradient[:, :count] += gradient[..., POSE:].sum(1)
