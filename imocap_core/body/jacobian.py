"""Keypoints and their analytic Jacobians by pose and shape, for all poses in a few products.

With right local increments ``R_local_k <- R_local_k @ exp(delta_k)`` everything below joint k
rotates about it by ``R_world_k @ delta_k``, so

    d p / d delta_k = (R_world_k delta_k) x arm_k
    arm_k            = sum of R_world_j lever_j over the joints j at or below k

where arm_k is the vector from k to the part of the point that is below k (``p - p_k`` for a joint).
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.body.model import Posed, Shaped
from imocap_core.body.points import Corrections, PointSet, posed_levers, rows_of, turn
from imocap_core.rotations import hat

KeypointsWithJacobian = tuple[
    Float[Tensor, "... K 3"], Float[Tensor, "... K 3 P"], Float[Tensor, "... K 3 n"]
]
"""xyz, metres; d_pose, P = 3 J, by right local increments in radians, joint by joint; d_shape per
unit of each coefficient. The derivative by transl is the identity."""


def keypoints_with_jacobian(
    shaped: Shaped,
    points: PointSet,
    R_local: Float[Tensor, "... J 3 3"],
    transl: Float[Tensor, "... 3"],
) -> KeypointsWithJacobian:
    """Keypoints of posed bodies with their derivatives by pose and shape.

    Parameters
    ----------
    shaped: coefficients (..., n), broadcast against the poses. One shape for many poses
        (coefficients (n,) or (M, 1, n)) is the fast case.
    R_local: rotations relative to the parent joint. transl: metres.
    """
    return points_with_jacobian(shaped.pose(R_local, transl), points)


def points_with_jacobian(posed: Posed, points: PointSet) -> KeypointsWithJacobian:
    """`keypoints_with_jacobian` of posed bodies."""
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


def _by_pose(
    R_world: Float[Tensor, "... J 3 3"],
    rows: Float[Tensor, "... 3 _"],
    levers: Float[Tensor, "... K J 3"],
    points: PointSet,
) -> Float[Tensor, "... K 3 P"]:
    """Derivatives by pose. Only pairs of a point and a joint that moves it are computed, N."""
    count, joints = points.moved_by.shape
    point_of, joint_of = points.moved_by.nonzero(as_tuple=True)
    hanging = levers[..., point_of, :, :] * points.below[joint_of][..., None]
    arm = turn(rows, hanging.flatten(-2).transpose(-1, -2)).transpose(-1, -2)  # (..., N, 3)
    x, y, z = arm[..., None].unbind(-2)
    a, b, c = R_world[..., joint_of, :, :].unbind(-2)  # rows of (..., N, 3): the increment's axes
    blocks = torch.stack((b * z - c * y, c * x - a * z, a * y - b * x), dim=-2)  # (..., N, 3, 3)
    # Each row of a block is three neighbouring numbers of the result: copy them there.
    axis = torch.arange(3, device=rows.device)
    place = ((point_of[:, None] * 3 + axis) * joints + joint_of[:, None]).flatten()
    batch = blocks.shape[:-3]
    result = blocks.new_zeros(*batch, count * 3 * joints, 3)
    result.index_copy_(len(batch), place, blocks.flatten(-3, -2))
    return result.view(*batch, count, 3, 3 * joints)


def _by_pose_blend(posed: Posed, corrections: Corrections) -> Float[Tensor, "... K 3 P"]:
    """Derivatives by pose of the pose blend shapes, whose offsets depend on local rotations."""
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


def _by_shape(
    rows: Float[Tensor, "... 3 _"], shaped: Shaped, points: PointSet
) -> Float[Tensor, "... K 3 n"]:
    """Derivatives by shape: levers and the root are linear in the shape."""
    count = shaped.coefficients.shape[-1]
    directions = points.levers_shapedirs[..., :count]  # (K, J, 3, n)
    columns = directions.movedim(0, 2).flatten(2).flatten(0, 1)  # (3 J, K n)
    turned = (rows @ columns).unflatten(-1, (len(points.names), count))
    return turned.transpose(-3, -2) + shaped.model.joints_shapedirs[0, :, :count]
