"""A camera's view of a batch of motions: projection and its derivative."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from imocap_core.motion.state import MotionState

NEAREST_M = 0.05  # points nearer to the camera plane than this are held there


@dataclass(frozen=True)
class View:
    """What one camera saw of each motion of the batch.

    Attributes:
        xy_px: (B, T, K, 2) detected keypoints (any value where ``weight`` is 0, but finite).
        weight: (B, T, K) confidence over the noise's variance, 1/px^2; 0 for a missing one.
        K: (B, 3, 3) intrinsics; R: (B, 3, 3), t: (B, 3) camera from the state's axes.
        camera: index of the state's free camera that takes the place of R and t, or None.
        focal: index of the state's free focal length that K's is multiplied by, or None.
        stray: (B, T, 6) inverse variances (1/rad^2, 1/m^2) with which this view's performance
            may turn and shift as a whole against the state (`stray`), or None.
    """

    xy_px: Tensor
    weight: Tensor
    K: Tensor
    R: Tensor
    t: Tensor
    camera: int | None = None
    focal: int | None = None
    stray: Tensor | None = None

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
            stray=None if self.stray is None else self.stray[own, :frames],
        )

    def at(self, state: MotionState) -> "View":
        """The view with the camera that the state holds."""
        view = self
        if self.camera is not None:
            c = self.camera
            view = replace(view, R=state.camera_R[:, c], t=state.camera_t[:, c])
        if self.focal is not None:
            view = replace(view, K=with_focal(self.K, state.log_focal[:, self.focal].exp()))
        return view

    def columns(self, state: MotionState) -> list[int]:
        """Where its free camera (turn, shift) and focal length stand among the globals."""
        own: list[int] = []
        if self.camera is not None:
            span = state.camera_columns(self.camera)
            own += range(span.start, span.stop)
        if self.focal is not None:
            own.append(state.focal_column(self.focal))
        return own


def with_focal(K: Tensor, factor: Tensor) -> Tensor:
    """`zooming.lens_of` of tensors: K (..., 3, 3) with focal lengths times ``factor`` (...)."""
    return K * torch.stack([factor, factor, torch.ones_like(factor)], -1)[..., None, :]


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
