"""What several views say of the same points, added to the normal equations at once.

A view's residuals depend on the body through its points alone. So what all views say is first
gathered a point, as 3 x 3 blocks, and carried to the unknowns by one product with the points'
Jacobian instead of one a view.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from imocap_core.motion.kinematics import Points
from imocap_core.motion.solver.normal import NormalEquations, add_product
from imocap_core.motion.state import POSE


@dataclass(frozen=True)
class Sight:
    """One view's weighted residuals and their derivatives.

    Attributes:
        residual: (B, T, 2K).
        by_point: (B, T, 2K, 3) by each residual's own point, the body having stayed as it is posed.
        turned: (B, T, 2K, 3) by the point of the common motion, before it strays.
        by_camera: (B, T, 2K, m) and the globals they belong to, or None: a known camera.
        strays: (B, T, 6, 2K) whitened derivative by the strays, as `whitened`, or None.
    """

    residual: Tensor
    by_point: Tensor
    turned: Tensor
    by_camera: Tensor | None = None
    columns: list[int] = field(default_factory=list)
    strays: Tensor | None = None


def whitened(by_stray: Tensor, precision: Tensor) -> Tensor:
    """(B, T, 6, R) rows V such that ``V^T V`` is what R residuals lose to their strays.

    Args:
        by_stray: (B, T, R, 6) S; precision: (B, T, 6) P.

    With S and P, the loss is ``S (S^T S + P)^-1 S^T``: the Schur complement that eliminates them.
    """
    own = by_stray.mT @ by_stray + torch.diag_embed(precision)
    factor, _ = torch.linalg.cholesky_ex(own)
    return torch.linalg.solve_triangular(factor, by_stray.mT, upper=False)


def add_sights(
    normal: NormalEquations, points: Points, sights: Sequence[Sight], movers: int
) -> None:
    """Add ``J^T W J`` and ``J^T W r`` of all views.

    The unknowns of a frame are pose and translation; of the globals the shape and the cameras. Of
    the pose the first ``movers`` joints alone move the points.
    """
    assert points.d_pose is not None
    assert points.d_beta is not None
    of_joints = slice(3 * movers)
    d_pose = points.d_pose[..., of_joints]
    pose, shape = d_pose.flatten(2, 3), points.d_beta.flatten(2, 3)  # (B, T, 3K, n)
    metric, mixed, moved = _metric(sights)
    add_product(normal.diagonal[..., of_joints, of_joints], pose, (metric @ d_pose).flatten(2, 3))
    residual, pull = _residual(sights)
    cameras = [s for s in sights if s.by_camera is not None]
    straying = [s for s in sights if s.strays is not None]
    columns = [mixed.flatten(2, 3), (metric @ points.d_beta).flatten(2, 3), residual]
    columns += [_by_points(s.turned, s.by_camera) for s in cameras]
    columns += [_by_points(s.turned, s.strays.mT) for s in straying if s.strays is not None]
    sizes = [x.shape[-1] for x in columns]
    together = torch.cat(columns, -1)
    of_pose, of_shape = ((x.mT @ together).split(sizes, -1) for x in (pose, shape))
    shapes = slice(shape.shape[-1])
    normal.diagonal[..., of_joints, POSE:] += of_pose[0]
    normal.diagonal[..., POSE:, of_joints] += of_pose[0].mT
    normal.diagonal[..., POSE:, POSE:] += moved
    normal.border[..., of_joints, shapes] += of_pose[1]
    normal.border[..., POSE:, shapes] += of_shape[0].mT
    normal.corner[:, shapes, shapes] += of_shape[1].sum(1)
    normal.gradient[..., of_joints] += of_pose[2][..., 0]
    normal.gradient[..., POSE:] += pull
    normal.corner_gradient[:, shapes] += of_shape[2][..., 0].sum(1)
    for sight, by_pose, by_shape in zip(cameras, of_pose[3:], of_shape[3:], strict=False):
        _add_camera(normal, sight, by_pose, by_shape)
    if straying:
        first = 3 + len(cameras)
        _take_strays(normal, straying, *(torch.cat(x[first:], -1) for x in (of_pose, of_shape)))


def _metric(sights: Sequence[Sight]) -> tuple[Tensor, Tensor, Tensor]:
    """What pose meets by pose and by translation, (B, T, K, 3, 3) a point, and translation by
    itself, (B, T, 3, 3)."""
    metric, mixed, moved = (torch.zeros((), device=sights[0].residual.device),) * 3
    for sight in sights:
        turned, still = (x.unflatten(2, (-1, 2)) for x in (sight.turned, sight.by_point))
        metric = metric + turned.mT @ turned
        mixed = mixed + turned.mT @ still
        moved = moved + sight.by_point.mT @ sight.by_point
    return metric, mixed, moved


def _residual(sights: Sequence[Sight]) -> tuple[Tensor, Tensor]:
    """The residuals' pull at the points of the common motion (B, T, 3K, 1), and at its place
    (B, T, 3)."""
    at_points = [_by_points(s.turned, s.residual[..., None]) for s in sights]
    at_place = [(s.by_point.mT @ s.residual[..., None])[..., 0] for s in sights]
    return torch.stack(at_points).sum(0), torch.stack(at_place).sum(0)


def _by_points(turned: Tensor, rows: Tensor | None) -> Tensor:
    """(B, T, 3K, n) of rows (B, T, 2K, n): each residual's, carried to its point."""
    assert rows is not None
    of_point = turned.unflatten(2, (-1, 2)).mT @ rows.unflatten(2, (-1, 2))
    return of_point.flatten(2, 3)


def _add_camera(normal: NormalEquations, sight: Sight, by_pose: Tensor, by_shape: Tensor) -> None:
    """A free camera's equations; by_pose (B, T, 3J, m), by_shape (B, T, n, m): with the others."""
    assert sight.by_camera is not None
    own, shapes, rows = sight.columns, slice(by_shape.shape[2]), sight.by_camera.flatten(1, 2)
    normal.border[..., : by_pose.shape[2], own] += by_pose
    normal.border[..., POSE:, own] += sight.by_point.mT @ sight.by_camera
    _add_corner(normal, own, shapes, by_shape.sum(1), rows.mT @ rows)
    normal.corner_gradient[:, own] += (rows.mT @ sight.residual.flatten(1)[..., None])[..., 0]


def _take_strays(
    normal: NormalEquations, sights: Sequence[Sight], by_pose: Tensor, by_shape: Tensor
) -> None:
    """Take away what the strays of V views could explain: a product of six rows a frame and view.

    The gradient stays: the strays' own is zero where they have settled.

    Args:
        by_pose: (B, T, 3J, 6V) derivatives of the strays by the pose; by_shape: (B, T, n, 6V).
    """
    shapes = slice(by_shape.shape[2])
    by_place = torch.cat([s.strays @ s.by_point for s in sights if s.strays is not None], -2)
    by_pose = torch.nn.functional.pad(by_pose, (0, 0, 0, POSE - by_pose.shape[2]))
    frame, others = torch.cat([by_pose, by_place.mT], -2), by_shape.mT  # (B, T, 75, 6V)
    add_product(normal.diagonal, frame.mT, frame.mT, share=-1.0)
    normal.border[..., shapes] -= frame @ others
    normal.corner[:, shapes, shapes] -= others.flatten(1, 2).mT @ others.flatten(1, 2)
    for k, sight in enumerate(sights):
        if sight.by_camera is None or sight.strays is None:
            continue
        own, camera = slice(6 * k, 6 * k + 6), sight.strays @ sight.by_camera
        normal.border[..., sight.columns] -= frame[..., own] @ camera
        flat = camera.flatten(1, 2)
        crossed = by_shape[..., own].transpose(1, 2).flatten(2) @ flat
        _add_corner(normal, sight.columns, shapes, -crossed, -flat.mT @ flat)


def _add_corner(
    normal: NormalEquations, own: list[int], shapes: slice, crossed: Tensor, square: Tensor
) -> None:
    normal.corner[:, [[k] for k in own], own] += square
    normal.corner[:, shapes, own] += crossed
    normal.corner[:, own, shapes] += crossed.mT
