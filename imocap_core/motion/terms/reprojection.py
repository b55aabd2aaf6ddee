"""L_2d of Eq. 3: detected keypoints against the projected body, in one or several views."""

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.robust import geman_mcclure
from imocap_core.motion.state import POSE, MotionState
from imocap_core.rotations import hat

NEAREST_M = 0.05  # points nearer to the camera plane than this are held there


@dataclass(frozen=True)
class View:
    """What one camera saw of each motion of the batch.

    Attributes:
        xy_px: (B, T, K, 2) detected keypoints (any value where ``weight`` is 0, but finite).
        weight: (B, T, K) confidence over the noise's variance, 1/px^2; 0 for a missing one.
        K: (B, 3, 3) intrinsics; R: (B, 3, 3), t: (B, 3) camera from the state's axes.
        camera: index of the state's free camera that takes the place of R and t, or None.
    """

    xy_px: Tensor
    weight: Tensor
    K: Tensor
    R: Tensor
    t: Tensor
    camera: int | None = None

    def of(self, v: int, frames: int) -> "View":
        """What was seen of motion ``v`` (batch of 1) in its first frames."""
        own = slice(v, v + 1)
        return replace(
            self,
            xy_px=self.xy_px[own, :frames],
            weight=self.weight[own, :frames],
            K=self.K[own],
            R=self.R[own],
            t=self.t[own],
        )

    def at(self, state: MotionState) -> "View":
        """The view with the camera that the state holds."""
        if self.camera is None:
            return self
        c = self.camera
        return replace(self, R=state.camera_R[:, c], t=state.camera_t[:, c])


def project(view: View, xyz: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels (B, T, K, 2) and camera-frame points (B, T, K, 3) of points in the state's axes."""
    x_cam = torch.einsum("bij,btkj->btki", view.R, xyz) + view.t[:, None, None]
    depth = x_cam[..., 2:].clamp_min(NEAREST_M)
    focal = torch.stack([view.K[:, 0, 0], view.K[:, 1, 1]], -1)[:, None, None]
    return x_cam[..., :2] / depth * focal + view.K[:, None, None, :2, 2], x_cam


def projection_jacobian(view: View, x_cam: Tensor) -> Tensor:
    """(B, T, K, 2, 3) derivative of the pixels by the point in CAMERA axes."""
    depth = x_cam[..., 2].clamp_min(NEAREST_M)
    fx, fy = view.K[:, 0, 0, None, None], view.K[:, 1, 1, None, None]
    zero = torch.zeros_like(depth)
    rows = [
        torch.stack([fx / depth, zero, -fx * x_cam[..., 0] / depth**2], -1),
        torch.stack([zero, fy / depth, -fy * x_cam[..., 1] / depth**2], -1),
    ]
    return torch.stack(rows, -2)


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

    def _squared(self, view: View, xyz: Tensor) -> Tensor:
        pixels, _ = project(view, xyz)
        return self._weighted(view, pixels - view.xy_px)

    def of(self, v: int, frames: int) -> Self:
        """What was seen of one motion."""
        return replace(self, views=tuple(view.of(v, frames) for view in self.views))

    def cost(self, state: MotionState) -> Tensor:
        """(B,) sum of rho over views, frames and keypoints."""
        xyz = self.body.positions(self.body.keypoints, state).xyz
        total = torch.zeros_like(state.betas[:, 0])
        for view in self.views:
            view = view.at(state)
            total = total + geman_mcclure(self._squared(view, xyz), self.scale)[0].sum((1, 2))
        return total

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """One weighted outer product of the stacked Jacobian rows per frame and view."""
        points = self.body.derivatives(self.body.keypoints, state)
        assert points.d_pose is not None
        assert points.d_beta is not None
        n, m = POSE + 3, state.betas.shape[1]
        for fixed in self.views:
            view = fixed.at(state)
            pixels, x_cam = project(view, points.xyz)
            error = pixels - view.xy_px
            weight = view.weight * geman_mcclure(self._weighted(view, error), self.scale)[1]
            root = weight.sqrt()[..., None]
            by_camera = projection_jacobian(view, x_cam) * root[..., None]
            by_point = by_camera @ view.R[:, None, None]
            parts = [by_point @ points.d_pose, by_point, by_point @ points.d_beta]
            columns = list(range(m))
            if view.camera is not None:
                parts.append(by_camera @ _by_camera(view, state, points.xyz))
                span = state.camera_columns(view.camera)
                columns += range(span.start, span.stop)
            rows = torch.cat(parts, -1).flatten(2, 3)
            residual = (error * root).flatten(2, 3)
            full = rows.transpose(-1, -2) @ rows
            gradient = (rows.transpose(-1, -2) @ residual[..., None])[..., 0]
            index = torch.tensor(columns, device=rows.device)
            normal.diagonal += full[..., :n, :n]
            normal.border.index_add_(3, index, full[..., :n, n:])
            normal.corner[:, index[:, None], index] += full[..., n:, n:].sum(1)
            normal.gradient += gradient[..., :n]
            normal.corner_gradient.index_add_(1, index, gradient[..., n:].sum(1))

    def _weighted(self, view: View, error: Tensor) -> Tensor:
        return view.weight * error.square().sum(-1)


def _by_camera(view: View, state: MotionState, xyz: Tensor) -> Tensor:
    """(B, T, K, 3, 6) derivative of camera-frame points by a camera's (turn, shift)."""
    lever = torch.einsum("bij,btkj->btki", view.R, xyz - state.pivot()[:, None, None])
    eye = torch.eye(3, dtype=xyz.dtype, device=xyz.device).expand(*lever.shape[:-1], 3, 3)
    return torch.cat([-hat(lever), eye], -1)
