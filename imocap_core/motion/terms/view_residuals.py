"""Residuals of several views of the same points, added to the normal equations at once.

A view's residuals depend on the body through its points alone. So the residuals of all views are
first gathered a point, as 3 x 3 blocks, and carried to the unknowns by one product with the points'
Jacobian instead of one a view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.kinematics import Points
from imocap_core.motion.solver.normal import NormalEquations, add_product
from imocap_core.motion.state import POSE


@dataclass(frozen=True)
class ViewResiduals:
    """One view's weighted residuals and their derivatives; R = 2 K of them a frame.

    Attributes:
        residual: (B, T, R).
        by_point: (B, T, R, 3) by each residual's point, rigid offset included.
        by_common_point: (B, T, R, 3) by the point of the common motion, without the offset.
        by_camera: (B, T, R, m) by the globals in ``columns``, or None: a known camera.
        by_offset: (B, T, 6, R) whitened derivative by the rigid offset (`whitened`), or None.
    """

    residual: Float[Tensor, "B T R"]
    by_point: Float[Tensor, "B T R 3"]
    by_common_point: Float[Tensor, "B T R 3"]
    by_camera: Float[Tensor, "B T R m"] | None = None
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
    normal: NormalEquations,
    points: Points,
    views: Sequence[ViewResiduals],
    movers: int,
    shapes: slice,
) -> None:
    """Add ``J^T W J`` and ``J^T W r`` of all views.

    The unknowns of a frame are pose and translation; of the globals the shape (in the columns
    ``shapes``) and the cameras. Of the pose the first ``movers`` joints alone move the points.
    """
    assert points.d_pose is not None
    assert points.d_beta is not None
    of_joints = slice(3 * movers)
    d_pose = points.d_pose[..., of_joints]
    pose, shape = d_pose.flatten(2, 3), points.d_beta.flatten(2, 3)  # (B, T, 3K, n)
    metric, mixed, moved = _metric(views)
    add_product(normal.diagonal[..., of_joints, of_joints], pose, (metric @ d_pose).flatten(2, 3))
    residual, pull = _residual(views)
    cameras = [view for view in views if view.by_camera is not None]
    offset = [view for view in views if view.by_offset is not None]
    columns = [mixed.flatten(2, 3), (metric @ points.d_beta).flatten(2, 3), residual]
    columns += [_at_points(view.by_common_point, view.by_camera) for view in cameras]
    columns += [
        _at_points(view.by_common_point, view.by_offset.mT)
        for view in offset
        if view.by_offset is not None
    ]
    sizes = [x.shape[-1] for x in columns]
    together = torch.cat(columns, -1)
    of_pose, of_shape = ((x.mT @ together).split(sizes, -1) for x in (pose, shape))
    normal.diagonal[..., of_joints, POSE:] += of_pose[0]
    normal.diagonal[..., POSE:, of_joints] += of_pose[0].mT
    normal.diagonal[..., POSE:, POSE:] += moved
    normal.border[..., of_joints, shapes] += of_pose[1]
    normal.border[..., POSE:, shapes] += of_shape[0].mT
    normal.corner[:, shapes, shapes] += of_shape[1].sum(1)
    normal.gradient[..., of_joints] += of_pose[2][..., 0]
    normal.gradient[..., POSE:] += pull
    normal.corner_gradient[:, shapes] += of_shape[2][..., 0].sum(1)
    for view, by_pose, by_shape in zip(cameras, of_pose[3:], of_shape[3:], strict=False):
        _add_camera(normal, view, by_pose, by_shape, shapes)
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


def _add_camera(
    normal: NormalEquations, view: ViewResiduals, by_pose: Tensor, by_shape: Tensor, shapes: slice
) -> None:
    """A free camera's equations; by_pose (B, T, 3J, m), by_shape (B, T, n, m): with the others."""
    assert view.by_camera is not None
    columns = view.columns
    rows = view.by_camera.flatten(1, 2)
    normal.border[..., : by_pose.shape[2], columns] += by_pose
    normal.border[..., POSE:, columns] += view.by_point.mT @ view.by_camera
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
        by_pose: (B, T, 3J, 6V) derivatives of the offsets by the pose; by_shape: (B, T, n, 6V).
    """
    by_translation = torch.cat(
        [view.by_offset @ view.by_point for view in views if view.by_offset is not None], -2
    )
    by_pose = torch.nn.functional.pad(by_pose, (0, 0, 0, POSE - by_pose.shape[2]))
    frame, others = torch.cat([by_pose, by_translation.mT], -2), by_shape.mT  # (B, T, 75, 6V)
    add_product(normal.diagonal, frame.mT, frame.mT, share=-1.0)
    normal.border[..., shapes] -= frame @ others
    normal.corner[:, shapes, shapes] -= others.flatten(1, 2).mT @ others.flatten(1, 2)
    for k, view in enumerate(views):
        if view.by_camera is None or view.by_offset is None:
            continue
        six, camera = slice(6 * k, 6 * k + 6), view.by_offset @ view.by_camera
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
