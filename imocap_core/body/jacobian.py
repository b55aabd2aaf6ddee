"""Keypoints and their analytic derivatives by pose and shape, all poses in a few products.

With right local increments ``R_local_k <- R_local_k @ exp(delta_k)`` everything below joint k
turns about it by ``R_world_k @ delta_k``, so

    d p / d delta_k = (R_world_k delta_k) x arm_k
    arm_k            = sum of R_world_j lever_j over the joints j at or below k

where arm_k is the part of the point that hangs below k, seen from k (``p - p_k`` for a joint).
"""

from __future__ import annotations

import torch
from torch import Tensor

from imocap_core.body.model import Posed, Shaped
from imocap_core.body.points import Corrections, PointSet, posed_levers, rows_of, turn
from imocap_core.rotations import hat


def keypoints_with_jacobian(
    shaped: Shaped, points: PointSet, R_local: Tensor, transl: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Keypoints of posed bodies with their derivatives.

    Parameters
    ----------
    shaped: coefficients (..., n), broadcast against the poses. One shape for many poses
        (coefficients (n,) or (M, 1, n)) is the fast case.
    R_local: (..., J, 3, 3). transl: (..., 3), metres.

    Returns
    -------
    xyz (..., K, 3), metres; d_pose (..., K, 3, 3 J) by right local increments in radians, joint
    by joint; d_shape (..., K, 3, n) per unit of each coefficient. By transl it is the identity.
    """
    return points_with_jacobian(shaped.pose(R_local, transl), points)


def points_with_jacobian(posed: Posed, points: PointSet) -> tuple[Tensor, Tensor, Tensor]:
    """`keypoints_with_jacobian` of bodies that have been posed."""
    shaped, rows = posed.shaped, rows_of(posed.R_world)
    levers = posed_levers(posed, points)
    placed = turn(rows, levers.flatten(-2).transpose(-1, -2)).transpose(-1, -2)
    xyz = placed + shaped.joints_rest[..., :1, :] + posed.transl[..., None, :]
    d_pose = _by_pose(posed.R_world, rows, levers, points)
    if points.corrections is not None:
        d_pose = d_pose + _by_pose_blend(posed, points.corrections)
    d_shape = _by_shape(rows, shaped, points)
    batch = xyz.shape[:-2]
    return xyz, d_pose.expand(*batch, -1, -1, -1), d_shape.expand(*batch, -1, -1, -1)


def _by_pose(R_world: Tensor, rows: Tensor, levers: Tensor, points: PointSet) -> Tensor:
    """(..., K, 3, 3 J). Only the P pairs of a point and a joint that moves it are worked out."""
    count, joints = points.moved_by.shape
    point_of, joint_of = points.moved_by.nonzero(as_tuple=True)
    hanging = levers[..., point_of, :, :] * points.below[joint_of][..., None]
    arm = turn(rows, hanging.flatten(-2).transpose(-1, -2)).transpose(-1, -2)  # (..., P, 3)
    x, y, z = arm[..., None].unbind(-2)
    a, b, c = R_world[..., joint_of, :, :].unbind(-2)  # rows of (..., P, 3): the increment's axes
    blocks = torch.stack((b * z - c * y, c * x - a * z, a * y - b * x), dim=-2)  # (..., P, 3, 3)
    # Each row of a block is three neighbouring numbers of the result: copy them to their place.
    axis = torch.arange(3, device=rows.device)
    place = ((point_of[:, None] * 3 + axis) * joints + joint_of[:, None]).flatten()
    batch = blocks.shape[:-3]
    result = blocks.new_zeros(*batch, count * 3 * joints, 3)
    result.index_copy_(len(batch), place, blocks.flatten(-3, -2))
    return result.view(*batch, count, 3, 3 * joints)


def _by_pose_blend(posed: Posed, corrections: Corrections) -> Tensor:
    """(..., K, 3, 3 J): the part of pose blend shapes, whose offsets follow each local rotation."""
    R_local, R_world = posed.R_local, posed.R_world
    identity = torch.eye(3, dtype=R_local.dtype, device=R_local.device)
    # d R_local / d delta_i = R_local hat(e_i), for each joint but the root: (..., J - 1, 3, 9)
    turned = R_local[..., 1:, None, :, :] @ hat(identity)
    directions = corrections.directions.unflatten(-1, (-1, 9))  # (U, 3, J - 1, 9)
    offsets = torch.einsum("ucjf,...jif->...ucji", directions, turned.flatten(-2)).flatten(-2)
    blended = torch.einsum("uj,...jab->...uab", corrections.weights, R_world)
    moved = torch.einsum("ku,...uci->...kci", corrections.shares, blended @ offsets)
    root = moved.new_zeros(*moved.shape[:-1], 3)
    return torch.cat((root, moved), dim=-1)


def _by_shape(rows: Tensor, shaped: Shaped, points: PointSet) -> Tensor:
    """(..., K, 3, n): levers and the root are linear in the shape."""
    count = shaped.coefficients.shape[-1]
    directions = points.levers_shapedirs[..., :count]  # (K, J, 3, n)
    columns = directions.movedim(0, 2).flatten(2).flatten(0, 1)  # (3 J, K n)
    turned = (rows @ columns).unflatten(-1, (len(points.names), count))
    return turned.transpose(-3, -2) + shaped.model.joints_shapedirs[0, :, :count]
