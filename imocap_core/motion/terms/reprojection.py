"""L_2d of Eq. 3: detected keypoints against the projected body, in one or several views.

Inner solve (variable projection): the rigid offsets that fit a view's frames best, at every state
that is tried. It is plain Gauss-Newton in one compiled loop, in the camera's axes, where a
projection's derivative has four entries; the prior keeps its steps from running away.

A view's residuals depend on the body through its points alone. So the residuals of all views are
first gathered a point, as 3 x 3 blocks, and carried to the unknowns by one product with the points'
Jacobian instead of one a view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.normal import NormalEquations, add_product
from imocap_core.motion.state import POSE, Body, MotionState, MovedPoints
from imocap_core.motion.terms.base import pieces
from imocap_core.motion.terms.view import (
    NEAREST_M,
    RIGID,
    View,
    by_rigid_offset,
    project,
    projection_jacobian,
    with_rigid_offset,
)
from imocap_core.robust import geman_mcclure
from imocap_core.rotations import exp, fill_rotation, hat
from imocap_core.workers import compiled

INNER_STEPS = 30  # at most
CONVERGED = 1e-4  # rad, m: change of an offset in the last step


@torch.no_grad()  # at their optimum the offsets' change does not change the cost
def solve_rigid_offsets(
    view: View,
    scale: float,
    xyz: Float[Tensor, "B T K 3"],
    pivot: Float[Tensor, "B T 3"],
    precision: Float[Tensor, "B T 6"],
    start: Float[Tensor, "B T 6"] | None = None,
) -> tuple[Float[Tensor, "B T 6"], Float[Tensor, "B T 6 6"]]:
    """Rigid offsets of a view's frames, and their precision matrices.

    Args:
        view: the detected keypoints; scale: of the Geman-McClure loss.
        xyz: points of the common motion; pivot: its root.
        precision: inverse variances of the offsets, 1/rad^2 and 1/m^2.
        start: offsets of a nearby problem, or None: from zero.

    Returns:
        Rotation and translation in the state's axes, and their inverse covariance.
    """
    R, centre = view.R[:, None], view.K[:, None, None, :2, 2]
    both = _twice(view.R)[:, None]  # rotation and translation, to camera axes
    d = torch.zeros_like(precision) if start is None else _to_state(start, view.R.mT)
    system = xyz.new_zeros(*precision.shape, 7)  # of every frame, the gradient in the last column
    fixed = (
        (xyz - pivot[..., None, :]) @ R.mT,  # arms from the root, in camera axes
        (R @ pivot[..., None])[..., 0] + view.shift,
        view.xy_px - centre,
        view.weight,
        torch.stack([view.K[:, 0, 0], view.K[:, 1, 1]], -1),
        both @ torch.diag_embed(precision) @ both.mT,
    )
    arrays = tuple(x.cpu().double().contiguous().numpy() for x in (*fixed, view.R))
    offsets, systems = (x.cpu().double().contiguous().numpy() for x in (d, system))
    _solve(arrays, scale, INNER_STEPS, CONVERGED, offsets, systems)
    d, sharpness = (torch.as_tensor(x).to(xyz) for x in (offsets, systems[..., :6]))
    return _to_state(d, view.R), both.mT @ sharpness @ both


def _to_state(d: Tensor, R: Tensor) -> Tensor:
    """Offsets (B, T, 6) from camera axes to the state's."""
    return (d.unflatten(-1, (2, 3)).flatten(1, 2) @ R).view(d.shape)


def _twice(R: Tensor) -> Tensor:
    """(B, 6, 6) with R (B, 3, 3) twice on the diagonal."""
    both = R.new_zeros(len(R), 6, 6)
    both[:, :3, :3] = both[:, 3:, 3:] = R
    return both


@compiled
def _solve(arrays, scale, steps, converged, d, system):  # type: ignore[no-untyped-def]
    """Offsets d (B, T, 6) in camera axes, in place, and the last step's equations (B, T, 6, 7)."""
    arms, root, xy_px, weight, focal, prior, turns = arrays
    batch, frames = d.shape[:2]
    step = np.empty(6)
    for _ in range(steps):
        largest = 0.0
        for b in range(batch):
            for t in range(frames):
                rows, now = system[b, t], d[b, t]
                rows[:, :6] = prior[b, t]
                for i in range(6):
                    rows[i, 6] = 0.0
                    for j in range(6):
                        rows[i, 6] += prior[b, t, i, j] * now[j]
                _add_points(
                    rows, arms[b, t], root[b, t], xy_px[b, t], weight[b, t], focal[b], scale, now
                )
                _solve_six(rows, step)
                for i in range(6):
                    now[i] -= step[i]
                for first in (0, 3):
                    for i in range(3):
                        change = 0.0
                        for j in range(3):
                            change += step[first + j] * turns[b, j, i]
                        largest = max(largest, abs(change))
        if largest < converged:
            break


@compiled
def _add_points(rows, arms, root, xy_px, weight, focal, scale, d):  # type: ignore[no-untyped-def]
    """Add one frame's ``J^T W [J | r]`` to rows (6, 7).

    An arm a at the end of a derivative J by the point rotates it: ``J (w x a) = (a x J) w``.
    """
    R = np.empty((3, 3))
    fill_rotation(d[0], d[1], d[2], R)
    J = np.empty((2, 7))
    for k in range(len(arms)):
        if weight[k] == 0.0:
            continue
        x, y, z = arms[k, 0], arms[k, 1], arms[k, 2]
        ax = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
        ay = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
        az = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
        nearness = 1 / max(az + root[2] + d[5], NEAREST_M)
        x, y = (ax + root[0] + d[3]) * nearness, (ay + root[1] + d[4]) * nearness
        u, v = x * focal[0] - xy_px[k, 0], y * focal[1] - xy_px[k, 1]
        robust = scale**2 / (scale**2 + weight[k] * (u * u + v * v))
        share = np.sqrt(weight[k]) * robust
        ux, vy = share * nearness * focal[0], share * nearness * focal[1]
        uz, vz = -ux * x, -vy * y
        J[0, 0], J[0, 1], J[0, 2], J[0, 3], J[0, 4] = ay * uz, az * ux - ax * uz, -ay * ux, ux, 0.0
        J[1, 0], J[1, 1], J[1, 2], J[1, 3], J[1, 4] = ay * vz - az * vy, -ax * vz, ax * vy, 0.0, vy
        J[0, 5], J[0, 6], J[1, 5], J[1, 6] = uz, u * share, vz, v * share
        for i in range(6):
            for j in range(i, 7):
                rows[i, j] += J[0, i] * J[0, j] + J[1, i] * J[1, j]
    for i in range(6):
        rows[i:, i] = rows[i, i:6]


@compiled
def _solve_six(rows, step):  # type: ignore[no-untyped-def]
    """The step of one frame's symmetric equations (6, 7), by Cholesky's factorisation."""
    L = np.zeros((6, 6))
    for i in range(6):
        for j in range(i + 1):
            rest = rows[i, j]
            for k in range(j):
                rest -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(rest) if i == j else rest / L[j, j]
    for i in range(6):
        step[i] = rows[i, 6]
        for k in range(i):
            step[i] -= L[i, k] * step[k]
        step[i] /= L[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            step[i] -= L[k, i] * step[k]
        step[i] /= L[i, i]


@dataclass(frozen=True)
class ViewResiduals:
    """One view's weighted residuals and their derivatives; R = 2 K of them a frame.

    Attributes:
        residual: (B, T, R).
        by_point: (B, T, R, 3) by each residual's point, rigid offset included.
        by_common_point: (B, T, R, 3) by the point of the common motion, without the offset.
        by_globals: (B, T, R, m) by those in ``columns``, or None: a known camera and no modes.
        by_offset: (B, T, 6, R) whitened derivative by the rigid offset (`whitened`), or None.
    """

    residual: Float[Tensor, "B T R"]
    by_point: Float[Tensor, "B T R 3"]
    by_common_point: Float[Tensor, "B T R 3"]
    by_globals: Float[Tensor, "B T R m"] | None = None
    columns: list[int] = field(default_factory=list)
    by_offset: Float[Tensor, "B T 6 R"] | None = None


def whitened(
    by_offset: Float[Tensor, "B T R 6"], precision: Float[Tensor, "B T 6"]
) -> Float[Tensor, "B T 6 R"]:
    """Rows V such that ``V^T V`` is the information that R residuals lose to their offset.

    With the derivative S and the precision P the loss is ``S (S^T S + P)^-1 S^T``: the Schur
    complement that eliminates the offset.
    """
    information = by_offset.mT @ by_offset + torch.diag_embed(precision)
    factor, _ = torch.linalg.cholesky_ex(information)
    return torch.linalg.solve_triangular(factor, by_offset.mT, upper=False)


def add_view_residuals(
    normal: NormalEquations, points: MovedPoints, views: Sequence[ViewResiduals], shapes: slice
) -> None:
    """Add ``J^T W J`` and ``J^T W r`` of all views.

    The unknowns of a frame are pose and translation; shapes: columns of the globals.
    """
    shape = points.d_beta.flatten(2, 3)  # (B, T, 3K, n)
    metric, mixed, moved = _metric(views)
    points.add_products(normal.diagonal[..., :POSE, :POSE], points, metric)
    residual, pull = _residual(views)
    cameras = [view for view in views if view.by_globals is not None]
    offset = [view for view in views if view.by_offset is not None]
    columns = [mixed.flatten(2, 3), (metric @ points.d_beta).flatten(2, 3), residual]
    columns += [_at_points(view.by_common_point, view.by_globals) for view in cameras]
    columns += [
        _at_points(view.by_common_point, view.by_offset.mT)
        for view in offset
        if view.by_offset is not None
    ]
    sizes = [x.shape[-1] for x in columns]
    together = torch.cat(columns, -1)
    of_pose = points.pulled(together.unflatten(2, (-1, 3)))[..., :POSE, :].split(sizes, -1)
    of_shape = (shape.mT @ together).split(sizes, -1)
    normal.diagonal[..., :POSE, POSE:] += of_pose[0]
    normal.diagonal[..., POSE:, :POSE] += of_pose[0].mT
    normal.diagonal[..., POSE:, POSE:] += moved
    normal.border[..., :POSE, shapes] += of_pose[1]
    normal.border[..., POSE:, shapes] += of_shape[0].mT
    normal.corner[:, shapes, shapes] += of_shape[1].sum(1)
    normal.gradient[..., :POSE] += of_pose[2][..., 0]
    normal.gradient[..., POSE:] += pull
    normal.corner_gradient[:, shapes] += of_shape[2][..., 0].sum(1)
    for view, by_pose, by_shape in zip(cameras, of_pose[3:], of_shape[3:], strict=False):
        _add_globals(normal, view, by_pose, by_shape, shapes)
    if offset:
        first = 3 + len(cameras)
        by_pose, by_shape = (torch.cat(x[first:], -1) for x in (of_pose, of_shape))
        _eliminate_offsets(normal, offset, by_pose, by_shape, shapes)


def _metric(views: Sequence[ViewResiduals]) -> tuple[Tensor, Tensor, Tensor]:
    """Products of pose with pose and with translation, (B, T, K, 3, 3) a point, and of translation
    with itself, (B, T, 3, 3)."""
    metric, mixed, moved = (torch.zeros((), device=views[0].residual.device),) * 3
    for view in views:
        common, point = (x.unflatten(2, (-1, 2)) for x in (view.by_common_point, view.by_point))
        metric = metric + common.mT @ common
        mixed = mixed + common.mT @ point
        moved = moved + view.by_point.mT @ view.by_point
    return metric, mixed, moved


def _residual(views: Sequence[ViewResiduals]) -> tuple[Tensor, Tensor]:
    """Gradient by the points of the common motion (B, T, 3K, 1), and by its translation
    (B, T, 3)."""
    by_points = [_at_points(view.by_common_point, view.residual[..., None]) for view in views]
    by_translation = [(view.by_point.mT @ view.residual[..., None])[..., 0] for view in views]
    return torch.stack(by_points).sum(0), torch.stack(by_translation).sum(0)


def _at_points(by_common_point: Tensor, rows: Tensor | None) -> Tensor:
    """(B, T, 3K, n) of rows (B, T, 2K, n): each residual's, carried to its point."""
    assert rows is not None
    of_point = by_common_point.unflatten(2, (-1, 2)).mT @ rows.unflatten(2, (-1, 2))
    return of_point.flatten(2, 3)


def _add_globals(
    normal: NormalEquations, view: ViewResiduals, by_pose: Tensor, by_shape: Tensor, shapes: slice
) -> None:
    """A camera's equations, and scores'; by_pose (B, T, 72, m), by_shape (B, T, n, m): mixed."""
    assert view.by_globals is not None
    columns = view.columns
    rows = view.by_globals.flatten(1, 2)
    normal.border[..., :POSE, columns] += by_pose
    normal.border[..., POSE:, columns] += view.by_point.mT @ view.by_globals
    _add_corner(normal, columns, shapes, by_shape.sum(1), rows.mT @ rows)
    gradient = (rows.mT @ view.residual.flatten(1)[..., None])[..., 0]
    normal.corner_gradient[:, columns] += gradient


def _eliminate_offsets(
    normal: NormalEquations,
    views: Sequence[ViewResiduals],
    by_pose: Tensor,
    by_shape: Tensor,
    shapes: slice,
) -> None:
    """Subtract what the rigid offsets of V views could explain: six rows a frame and view.

    The gradient stays: the offsets' own is zero once the inner solve has converged.

    Args:
        by_pose: (B, T, 72, 6V) derivatives of the offsets by the pose; by_shape: (B, T, n, 6V).
    """
    by_translation = torch.cat(
        [view.by_offset @ view.by_point for view in views if view.by_offset is not None], -2
    )
    frame, others = torch.cat([by_pose, by_translation.mT], -2), by_shape.mT  # (B, T, 75, 6V)
    add_product(normal.diagonal, frame.mT, frame.mT, share=-1.0)
    normal.border[..., shapes] -= frame @ others
    normal.corner[:, shapes, shapes] -= others.flatten(1, 2).mT @ others.flatten(1, 2)
    for k, view in enumerate(views):
        if view.by_globals is None or view.by_offset is None:
            continue
        six, camera = slice(6 * k, 6 * k + 6), view.by_offset @ view.by_globals
        normal.border[..., view.columns] -= frame[..., six] @ camera
        flat = camera.flatten(1, 2)
        crossed = by_shape[..., six].transpose(1, 2).flatten(2) @ flat
        _add_corner(normal, view.columns, shapes, -crossed, -flat.mT @ flat)


def _add_corner(
    normal: NormalEquations, columns: list[int], shapes: slice, crossed: Tensor, square: Tensor
) -> None:
    normal.corner[:, [[k] for k in columns], columns] += square
    normal.corner[:, shapes, columns] += crossed
    normal.corner[:, columns, shapes] += crossed.mT


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
        xyz = self._points(view, state)
        if view.offset_precision is None:
            return xyz, xyz.new_zeros(*xyz.shape[:2], RIGID)
        d, _ = self.rigid_offsets(view, state, view.offset_precision)
        return with_rigid_offset(xyz, self._pivot(state.of_performer(view.performer)), d), d

    def rigid_offsets(
        self,
        view: View,
        state: MotionState,
        precision: Float[Tensor, "B T 6"],
        start: Float[Tensor, "B T 6"] | None = None,
    ) -> tuple[Float[Tensor, "B T 6"], Float[Tensor, "B T 6 6"]]:
        """A view's rigid offsets and their precision matrices (`solve_rigid_offsets`)."""
        xyz, pivot = self._points(view, state), self._pivot(state.of_performer(view.performer))
        seen_by = view.with_camera_of(state)
        return solve_rigid_offsets(seen_by, self.scale, xyz, pivot, precision, start)

    def _points(self, view: View, state: MotionState) -> Tensor:
        shown = state.of_performer(view.performer)
        return view.shifted(self.body.positions(self.body.keypoints, shown), state)

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
                add_view_residuals(normal.of_frames(frames), points, views, shapes)

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
        if view.offset_precision is not None:
            pivot = self._pivot(state.of_performer(view.performer))[:, frames]
            rows = by_rigid_offset(by_point, xyz, pivot, d).flatten(2, 3)
            residuals = replace(
                residuals,
                by_common_point=residuals.by_point @ exp(d[..., :3]),
                by_offset=whitened(rows, view.offset_precision),
            )
        if columns := view.columns(state):
            off_centre = (pixels - view.K[:, None, None, :2, 2]) * root[..., None]
            parts = _by_camera(view, state, xyz, by_camera_axes, off_centre)
            if view.shifts is not None:
                parts.append(residuals.by_common_point.unflatten(2, (-1, 2)) @ view.shifts)
            rows = torch.cat(parts, -1).flatten(2, 3)
            residuals = replace(residuals, by_globals=rows, columns=columns)
        return residuals

    def _weighted(self, view: View, error: Tensor) -> Tensor:
        return view.weight * error.square().sum(-1)


def _by_camera(
    view: View, state: MotionState, xyz: Tensor, by_axes: Tensor, off_centre: Tensor
) -> list[Tensor]:
    """(B, T, K, 2, n) derivatives by the camera's unknowns, the focal length last.

    Args:
        by_axes: (B, T, K, 2, 3) by the point in camera axes; off_centre: (B, T, K, 2) weighted
            pixels from the principal point, which grow with the focal length.
    """
    parts = []
    if view.camera is not None:
        parts.append(by_axes @ _by_rotation_and_translation(view, state, xyz))
    if view.focal is not None:
        parts.append(off_centre[..., None])
    return parts


def _by_rotation_and_translation(view: View, state: MotionState, xyz: Tensor) -> Tensor:
    """(B, T, K, 3, 6) derivative of camera-frame points by a camera's increments."""
    lever = torch.einsum("bij,btkj->btki", view.R, xyz - state.pivot()[:, None, None])
    eye = torch.eye(3, dtype=xyz.dtype, device=xyz.device).expand(*lever.shape[:-1], 3, 3)
    return torch.cat([-hat(lever), eye], -1)
