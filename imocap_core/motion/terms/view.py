"""A camera's view of a batch of motions: projection and its derivative, rigid offsets.

Whoever repeats an action stands and faces elsewhere, a little, at every moment: in a view of the
common motion six numbers a frame, ``d = (rotation, translation)``, small with a given spread. They
are minimised out of each frame's residuals (variable projection), so the objective stays a function
of the common motion alone and its equations lose what offsets could explain (Schur).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.state import MotionState
from imocap_core.rotations import exp, hat

NEAREST_M = 0.05  # least depth: points nearer to the camera plane are projected from there


@dataclass(frozen=True)
class View:
    """One camera's keypoints of each motion of the batch.

    Attributes:
        xy_px: (B, T, K, 2) detected keypoints (any value where ``weight`` is 0, but finite).
        weight: (B, T, K) confidence over the noise's variance, 1/px^2; 0 for a missing one.
        K: (B, 3, 3) intrinsics; R: (B, 3, 3), t: (B, 3) camera from the state's axes.
        camera: index of the state's free camera that replaces R and t, or None.
        focal: index of the state's free focal length that K's is multiplied by, or None.
        offset_precision: (B, T, 6) inverse variances (1/rad^2, 1/m^2) of this view's per-frame
            rigid offset against the state (`rigid_offset`), or None: no offset.
        performer: index of the shape, among those of the state, of the body that it shows.
        centre: (B, T, 3) place of a camera that moves, in the axes that R and t lead to: a point
            is seen at ``R x + t - centre``; None: on one spot.
        shifts: (B, T, K, 3, k) of the keypoints in the state's axes, metres, at a score of 1 in
            each mode of variation, or None: no modes; performance: whose scores it shows.
    """

    xy_px: Float[Tensor, "B T K 2"]
    weight: Float[Tensor, "B T K"]
    K: Float[Tensor, "B 3 3"]
    R: Float[Tensor, "B 3 3"]
    t: Float[Tensor, "B 3"]
    camera: int | None = None
    focal: int | None = None
    offset_precision: Float[Tensor, "B T 6"] | None = None
    performer: int = 0
    centre: Float[Tensor, "B T 3"] | None = None
    shifts: Float[Tensor, "B T K 3 k"] | None = None
    performance: int = 0

    @property
    def shift(self) -> Float[Tensor, "B #T 3"]:
        """What is added to rotated points: the translation, less the place of a moving camera."""
        t = self.t[:, None]
        return t if self.centre is None else t - self.centre

    def of(self, v: int, frames: int) -> View:
        """The view of motion ``v`` (batch of 1) in its first frames."""
        return self._cut(slice(v, v + 1), slice(frames))

    def of_frames(self, frames: slice) -> View:
        """The view in some frames of every motion."""
        return self._cut(slice(None), frames)

    def _cut(self, row: slice, frames: slice) -> View:
        names = ("offset_precision", "centre", "shifts")
        given = {n: x[row, frames] for n in names if (x := getattr(self, n)) is not None}
        return replace(
            self,
            xy_px=self.xy_px[row, frames],
            weight=self.weight[row, frames],
            K=self.K[row],
            R=self.R[row],
            t=self.t[row],
            **given,
        )

    def with_camera_of(self, state: MotionState) -> View:
        """The view with the state's free camera and focal length."""
        view = self
        if self.camera is not None:
            c = self.camera
            view = replace(view, R=state.camera_R[:, c], t=state.camera_t[:, c])
        if self.focal is not None:
            view = replace(view, K=with_focal(self.K, state.log_focal[:, self.focal].exp()))
        return view

    def columns(self, state: MotionState) -> list[int]:
        """Indices of its free camera (rotation, translation) and focal length among the globals."""
        columns: list[int] = []
        if self.camera is not None:
            span = state.camera_columns(self.camera)
            columns += range(span.start, span.stop)
        if self.focal is not None:
            columns.append(state.focal_column(self.focal))
        if self.shifts is not None:
            span = state.score_columns(self.performance)
            columns += range(span.start, span.stop)
        return columns

    def shifted(self, xyz: Tensor, state: MotionState) -> Float[Tensor, "B T K 3"]:
        """Points of the common motion as this performance has them, by its scores."""
        if self.shifts is None:
            return xyz
        scores = state.scores[:, self.performance]
        return xyz + (self.shifts @ scores[:, None, None, :, None])[..., 0]


def with_focal(
    K: Float[Tensor, "... 3 3"], factor: Float[Tensor, "..."]
) -> Float[Tensor, "... 3 3"]:
    """Intrinsics with focal lengths multiplied by a factor."""
    return K * torch.stack([factor, factor, torch.ones_like(factor)], -1)[..., None, :]


def project(
    view: View, xyz: Float[Tensor, "B T K 3"]
) -> tuple[Float[Tensor, "B T K 2"], Float[Tensor, "B T K 3"]]:
    """Pixels and camera-frame points of points in the state's axes."""
    x_cam = torch.einsum("bij,btkj->btki", view.R, xyz) + view.shift[:, :, None]
    depth = x_cam[..., 2:].clamp_min(NEAREST_M)
    focal = torch.stack([view.K[:, 0, 0], view.K[:, 1, 1]], -1)[:, None, None]
    return x_cam[..., :2] / depth * focal + view.K[:, None, None, :2, 2], x_cam


def projection_jacobian(view: View, x_cam: Float[Tensor, "B T K 3"]) -> Float[Tensor, "B T K 2 3"]:
    """Derivative of the pixels by the point in CAMERA axes."""
    depth = x_cam[..., 2].clamp_min(NEAREST_M)
    fx, fy = view.K[:, 0, 0, None, None], view.K[:, 1, 1, None, None]
    zero = torch.zeros_like(depth)
    rows = [
        torch.stack([fx / depth, zero, -fx * x_cam[..., 0] / depth**2], -1),
        torch.stack([zero, fy / depth, -fy * x_cam[..., 1] / depth**2], -1),
    ]
    return torch.stack(rows, -2)


RIGID = 6


def with_rigid_offset(
    xyz: Float[Tensor, "B T K 3"], pivot: Float[Tensor, "B T 3"], d: Float[Tensor, "B T 6"]
) -> Float[Tensor, "B T K 3"]:
    """Points rotated about the pivot, then translated; rad and metres."""
    arms = xyz - pivot[..., None, :]
    rotated = torch.einsum("btij,btkj->btki", exp(d[..., :3]), arms)
    return rotated + (pivot + d[..., 3:])[..., None, :]


def by_rigid_offset(
    by_point: Float[Tensor, "B T K 2 3"],
    xyz: Float[Tensor, "B T K 3"],
    pivot: Float[Tensor, "B T 3"],
    d: Float[Tensor, "B T 6"],
) -> Float[Tensor, "B T K 2 6"]:
    """Derivative of residuals by the offset, at points xyz that already have it."""
    arms = xyz - (pivot + d[..., 3:])[..., None, :]
    return torch.cat([by_point @ -hat(arms), by_point], -1)
