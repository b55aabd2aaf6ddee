"""L_2d of Eq. 3: detected keypoints against the projected body, in one or several views."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms.in_time import pieces
from imocap_core.motion.terms.inner_solve import solve_rigid_offsets
from imocap_core.motion.terms.rigid_offset import RIGID, by_rigid_offset, with_rigid_offset
from imocap_core.motion.terms.view import View, project, projection_jacobian
from imocap_core.motion.terms.view_residuals import ViewResiduals, add_view_residuals, whitened
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

    def of(self, v: int, frames: int) -> Reprojection:
        """The views of one motion."""
        return replace(self, views=tuple(view.of(v, frames) for view in self.views))

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Sum of rho over views, frames and keypoints, and the cost of rigid offsets."""
        total = torch.zeros_like(state.betas[:, 0])
        for fixed in self.views:
            view = fixed.with_camera_of(state)
            xyz, d = self.offset_points(fixed, state)
            squared = self._weighted(view, project(view, xyz)[0] - view.xy_px)
            total = total + geman_mcclure(squared, self.scale)[0].sum((1, 2))
            if view.offset_precision is not None:
                total = total + (view.offset_precision * d.square()).sum((1, 2))
        return total

    def offset_points(
        self, view: View, state: MotionState
    ) -> tuple[Float[Tensor, "B T K 3"], Float[Tensor, "B T 6"]]:
        """The body's points with a view's rigid offsets, and the offsets.

        Computed once per state: the cost needs them, and so do the equations of the next step.
        """
        return state.cached((self, view), lambda: self._solve_offsets(view, state))

    def _solve_offsets(self, view: View, state: MotionState) -> tuple[Tensor, Tensor]:
        state = state.of_performer(view.performer)
        xyz = self.body.positions(self.body.keypoints, state).xyz
        if view.offset_precision is None:
            return xyz, xyz.new_zeros(*xyz.shape[:2], RIGID)
        d, _ = self.rigid_offsets(view, state, view.offset_precision)
        return with_rigid_offset(xyz, self._pivot(state), d), d

    def rigid_offsets(
        self,
        view: View,
        state: MotionState,
        precision: Float[Tensor, "B T 6"],
        start: Float[Tensor, "B T 6"] | None = None,
    ) -> tuple[Float[Tensor, "B T 6"], Float[Tensor, "B T 6 6"]]:
        """A view's rigid offsets and their precision matrices (`solve_rigid_offsets`)."""
        state = state.of_performer(view.performer)
        xyz = self.body.positions(self.body.keypoints, state).xyz
        pivot = self._pivot(state)
        return solve_rigid_offsets(
            view.with_camera_of(state), self.scale, xyz, pivot, precision, start
        )

    def _pivot(self, state: MotionState) -> Tensor:
        rest = self.body.model.shape(state.betas).joints_rest[:, 0]
        return state.trans + rest[:, None]

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """All views of one performer at once (`view_residuals`), the frames piece by piece."""
        keypoints = self.body.keypoints
        for performer in sorted({view.performer for view in self.views}):
            shown = [view for view in self.views if view.performer == performer]
            shapes, body_state = state.shape_columns(performer), state.of_performer(performer)
            for frames in pieces(state.valid.shape[1]):
                points = self.body.derivatives(keypoints, body_state, frames)
                views = [self._residuals(view, state, frames) for view in shown]
                part = normal.of_frames(frames)
                add_view_residuals(part, points, views, keypoints.movers, shapes)

    def _residuals(self, whole: View, state: MotionState, frames: slice) -> ViewResiduals:
        """One view's weighted residuals in some frames, and their derivatives."""
        xyz, d = (x[:, frames] for x in self.offset_points(whole, state))
        view = whole.of_frames(frames).with_camera_of(state)
        pixels, x_cam = project(view, xyz)
        error = pixels - view.xy_px
        root = (view.weight * geman_mcclure(self._weighted(view, error), self.scale)[1]).sqrt()
        by_camera_axes = projection_jacobian(view, x_cam) * root[..., None, None]
        by_point = (by_camera_axes.flatten(1, 3) @ view.R).view(by_camera_axes.shape)
        residuals = ViewResiduals(
            residual=(error * root[..., None]).flatten(2),
            by_point=by_point.flatten(2, 3),
            by_common_point=by_point.flatten(2, 3),
        )
        if columns := view.columns(state):
            off_centre = (pixels - view.K[:, None, None, :2, 2]) * root[..., None]
            rows = _by_camera(view, state, xyz, by_camera_axes, off_centre)
            residuals = replace(residuals, by_camera=rows.flatten(2, 3), columns=columns)
        if view.offset_precision is not None:
            pivot = self._pivot(state.of_performer(view.performer))[:, frames]
            rows = by_rigid_offset(by_point, xyz, pivot, d).flatten(2, 3)
            residuals = replace(
                residuals,
                by_common_point=residuals.by_point @ exp(d[..., :3]),
                by_offset=whitened(rows, view.offset_precision),
            )
        return residuals

    def _weighted(self, view: View, error: Tensor) -> Tensor:
        return view.weight * error.square().sum(-1)


def _by_camera(
    view: View, state: MotionState, xyz: Tensor, by_axes: Tensor, off_centre: Tensor
) -> Tensor:
    """(B, T, K, 2, n) derivative by the camera's unknowns, the focal length last.

    Args:
        by_axes: (B, T, K, 2, 3) by the point in camera axes; off_centre: (B, T, K, 2) weighted
            pixels from the principal point, which grow with the focal length.
    """
    parts = []
    if view.camera is not None:
        parts.append(by_axes @ _by_rotation_and_translation(view, state, xyz))
    if view.focal is not None:
        parts.append(off_centre[..., None])
    return torch.cat(parts, -1)


def _by_rotation_and_translation(view: View, state: MotionState, xyz: Tensor) -> Tensor:
    """(B, T, K, 3, 6) derivative of camera-frame points by a camera's increments."""
    lever = torch.einsum("bij,btkj->btki", view.R, xyz - state.pivot()[:, None, None])
    eye = torch.eye(3, dtype=xyz.dtype, device=xyz.device).expand(*lever.shape[:-1], 3, 3)
    return torch.cat([-hat(lever), eye], -1)
