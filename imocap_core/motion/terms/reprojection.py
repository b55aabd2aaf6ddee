"""L_2d of Eq. 3: detected keypoints against the projected body, in one or several views."""

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms.inner_solve import settle
from imocap_core.motion.terms.rigid_offset import RIGID, by_stray, strayed
from imocap_core.motion.terms.view import View, project, projection_jacobian
from imocap_core.motion.terms.view_residuals import Sight, add_sights, whitened
from imocap_core.robust import geman_mcclure
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
        total = torch.zeros_like(state.betas[:, 0])
        for fixed in self.views:
            view = fixed.at(state)
            at, d = self.placed(fixed, state)
            squared = self._weighted(view, project(view, at)[0] - view.xy_px)
            total = total + geman_mcclure(squared, self.scale)[0].sum((1, 2))
            if view.stray is not None:
                total = total + (view.stray * d.square()).sum((1, 2))
        return total

    def placed(self, view: View, state: MotionState) -> tuple[Tensor, Tensor]:
        """Where a view's performance has its points (B, T, K, 3), and its strays (B, T, 6).

        Found once a state: the cost needs it, and the equations of the step from there.
        """
        return state.once((self, view), lambda: self._place(view, state))

    def _place(self, view: View, state: MotionState) -> tuple[Tensor, Tensor]:
        xyz = self.body.positions(self.body.keypoints, state).xyz
        if view.stray is None:
            return xyz, xyz.new_zeros(*xyz.shape[:2], RIGID)
        pivot = self._pivot(state)
        d, _ = settle(view.at(state), self.scale, xyz, pivot, view.stray)
        return strayed(xyz, pivot, d), d

    def strays(
        self, view: View, state: MotionState, precision: Tensor, start: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """A view's strays (B, T, 6) and their precision matrices (B, T, 6, 6).

        ``start``: strays that were found nearby.
        """
        xyz = self.body.positions(self.body.keypoints, state).xyz
        return settle(view.at(state), self.scale, xyz, self._pivot(state), precision, start)

    def _pivot(self, state: MotionState) -> Tensor:
        rest = self.body.model.shape(state.betas).joints_rest[:, 0]
        return state.trans + rest[:, None]

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """All views at once (`sights`)."""
        keypoints = self.body.keypoints
        sights = [self._sight(view, state) for view in self.views]
        add_sights(normal, self.body.derivatives(keypoints, state), sights, keypoints.movers)

    def _sight(self, fixed: View, state: MotionState) -> Sight:
        """One view's weighted residuals and their derivatives."""
        xyz, d = self.placed(fixed, state)
        view = fixed.at(state)
        pixels, x_cam = project(view, xyz)
        error = pixels - view.xy_px
        root = (view.weight * geman_mcclure(self._weighted(view, error), self.scale)[1]).sqrt()
        by_camera_axes = projection_jacobian(view, x_cam) * root[..., None, None]
        by_point = (by_camera_axes.flatten(1, 3) @ view.R).view(by_camera_axes.shape)
        sight = Sight(
            residual=(error * root[..., None]).flatten(2),
            by_point=by_point.flatten(2, 3),
            turned=by_point.flatten(2, 3),
        )
        if columns := view.columns(state):
            off_centre = (pixels - view.K[:, None, None, :2, 2]) * root[..., None]
            rows = _by_camera(view, state, xyz, by_camera_axes, off_centre)
            sight = replace(sight, by_camera=rows.flatten(2, 3), columns=columns)
        if view.stray is not None:
            rows = by_stray(by_point, xyz, self._pivot(state), d).flatten(2, 3)
            turned = sight.by_point @ exp(d[..., :3])
            sight = replace(sight, turned=turned, strays=whitened(rows, view.stray))
        return sight

    def _weighted(self, view: View, error: Tensor) -> Tensor:
        return view.weight * error.square().sum(-1)


def _by_camera(
    view: View, state: MotionState, xyz: Tensor, by_axes: Tensor, off_centre: Tensor
) -> Tensor:
    """(B, T, K, 2, n) derivative by what of the camera is free, the focal length last.

    Args:
        by_axes: (B, T, K, 2, 3) by the point in camera axes; off_centre: (B, T, K, 2) weighted
            pixels from the principal point, which grow with the focal length.
    """
    parts = []
    if view.camera is not None:
        parts.append(by_axes @ _by_turn_and_shift(view, state, xyz))
    if view.focal is not None:
        parts.append(off_centre[..., None])
    return torch.cat(parts, -1)


def _by_turn_and_shift(view: View, state: MotionState, xyz: Tensor) -> Tensor:
    """(B, T, K, 3, 6) derivative of camera-frame points by a camera's (turn, shift)."""
    lever = torch.einsum("bij,btkj->btki", view.R, xyz - state.pivot()[:, None, None])
    eye = torch.eye(3, dtype=xyz.dtype, device=xyz.device).expand(*lever.shape[:-1], 3, 3)
    return torch.cat([-hat(lever), eye], -1)
