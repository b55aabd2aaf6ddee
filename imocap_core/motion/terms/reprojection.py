"""L_2d of Eq. 3: detected keypoints against the projected body, in one or several views."""

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from imocap_core.motion.kinematics import Body, Points
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.robust import geman_mcclure
from imocap_core.motion.state import POSE, MotionState
from imocap_core.motion.terms.stray import (
    RIGID,
    Pull,
    by_stray,
    settle,
    strayed,
    without_strays,
)
from imocap_core.motion.terms.view import View, project, projection_jacobian
from imocap_core.rotations import exp, hat


@dataclass(frozen=True)
class Reprojection:
    """Geman-McClure reprojection error over all views.

    Attributes:
        body: whose keypoints are projected.
        views: at least one.
        scale: Geman-McClure scale in units of the noise's standard deviation.
    """

    body: Body
    views: tuple[View, ...]
    scale: float

    def of(self, v: int, frames: int) -> Self:
        """What was seen of one motion."""
        return replace(self, views=tuple(view.of(v, frames) for view in self.views))

    def cost(self, state: MotionState) -> Tensor:
        """(B,) sum of rho over views, frames and keypoints, and what strays cost."""
        xyz = self.body.positions(self.body.keypoints, state).xyz
        total = torch.zeros_like(state.betas[:, 0])
        for fixed in self.views:
            view = fixed.at(state)
            at, d = self.placed(view, xyz, state)
            squared = self._weighted(view, project(view, at)[0] - view.xy_px)
            total = total + geman_mcclure(squared, self.scale)[0].sum((1, 2))
            if view.stray is not None:
                total = total + (view.stray * d.square()).sum((1, 2))
        return total

    def placed(self, view: View, xyz: Tensor, state: MotionState) -> tuple[Tensor, Tensor]:
        """Where a view's performance has its points (B, T, K, 3), and its strays (B, T, 6)."""
        if view.stray is None:
            return xyz, xyz.new_zeros(*xyz.shape[:2], RIGID)
        pivot = self._pivot(state)
        d, _ = settle(lambda at: self._pull(view, at), xyz, pivot, view.stray)
        return strayed(xyz, pivot, d), d

    def strays(self, view: View, state: MotionState, precision: Tensor) -> tuple[Tensor, Tensor]:
        """A view's strays (B, T, 6) and their precision matrices (B, T, 6, 6)."""
        xyz, view = self.body.positions(self.body.keypoints, state).xyz, view.at(state)
        return settle(lambda at: self._pull(view, at), xyz, self._pivot(state), precision)

    def _pivot(self, state: MotionState) -> Tensor:
        rest = self.body.model.shape(state.betas).joints_rest[:, 0]
        return state.trans + rest[:, None]

    def _pull(self, view: View, xyz: Tensor) -> Pull:
        by_camera, residual = self._by_camera_axes(view, xyz)
        return Pull(residual, by_camera @ view.R[:, None, None])

    def _by_camera_axes(self, view: View, xyz: Tensor) -> tuple[Tensor, Tensor]:
        """Weighted derivative by camera-frame points, and the weighted residual."""
        pixels, x_cam = project(view, xyz)
        error = pixels - view.xy_px
        weight = view.weight * geman_mcclure(self._weighted(view, error), self.scale)[1]
        root = weight.sqrt()[..., None]
        return projection_jacobian(view, x_cam) * root[..., None], error * root

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """One weighted outer product of the stacked Jacobian rows per frame and view."""
        points = self.body.derivatives(self.body.keypoints, state)
        for fixed in self.views:
            view = fixed.at(state)
            rows, residual = self._rows(view, points, state)
            full = rows.transpose(-1, -2) @ rows
            gradient = (rows.transpose(-1, -2) @ residual[..., None])[..., 0]
            if view.stray is not None:
                full, gradient = without_strays(full, gradient, view.stray)
            _add(normal, full, gradient, _columns(view, state))

    def _rows(self, view: View, points: Points, state: MotionState) -> tuple[Tensor, Tensor]:
        """(B, T, 2K, unknowns) by frame, shape, camera and strays; residual (B, T, 2K)."""
        assert points.d_pose is not None
        assert points.d_beta is not None
        xyz, d = self.placed(view, points.xyz, state)
        by_camera, residual = self._by_camera_axes(view, xyz)
        by_point = by_camera @ view.R[:, None, None]
        turned = by_point if view.stray is None else by_point @ exp(d[..., None, :3])
        parts = [turned @ points.d_pose, by_point, turned @ points.d_beta]
        if view.camera is not None:
            parts.append(by_camera @ _by_camera(view, state, xyz))
        if view.stray is not None:
            parts.append(by_stray(by_point, xyz, self._pivot(state), d))
        return torch.cat(parts, -1).flatten(2, 3), residual.flatten(2, 3)

    def _weighted(self, view: View, error: Tensor) -> Tensor:
        return view.weight * error.square().sum(-1)


def _columns(view: View, state: MotionState) -> list[int]:
    """Which globals a view's rows speak of: the shape and its free camera."""
    columns = list(range(state.betas.shape[1]))
    if view.camera is not None:
        span = state.camera_columns(view.camera)
        columns += range(span.start, span.stop)
    return columns


def _add(normal: NormalEquations, full: Tensor, gradient: Tensor, columns: list[int]) -> None:
    n = POSE + 3
    index = torch.tensor(columns, device=full.device)
    normal.diagonal += full[..., :n, :n]
    normal.border.index_add_(3, index, full[..., :n, n:])
    normal.corner[:, index[:, None], index] += full[..., n:, n:].sum(1)
    normal.gradient += gradient[..., :n]
    normal.corner_gradient.index_add_(1, index, gradient[..., n:].sum(1))


def _by_camera(view: View, state: MotionState, xyz: Tensor) -> Tensor:
    """(B, T, K, 3, 6) derivative of camera-frame points by a camera's (turn, shift)."""
    lever = torch.einsum("bij,btkj->btki", view.R, xyz - state.pivot()[:, None, None])
    eye = torch.eye(3, dtype=xyz.dtype, device=xyz.device).expand(*lever.shape[:-1], 3, 3)
    return torch.cat([-hat(lever), eye], -1)
