"""The SMPL body model as immutable values: Model -> Shaped -> Posed -> Mesh; its Jacobians.

Each value adds a shape, a pose or a surface to the one before and refers to it, so nothing is
computed twice and nothing can be out of date. All arrays are torch tensors of one device and
dtype; leading axes broadcast, e.g. betas (M, 1, 10) with R_local (M, T, 24, 3, 3). Model and
formulas: Loper et al., "SMPL", SIGGRAPH Asia 2015.

Keypoints and their analytic Jacobians by pose and shape, for all poses in a few products. With
right local increments ``R_local_k <- R_local_k @ exp(delta_k)`` everything below joint k rotates
about it by ``R_world_k @ delta_k``, so

    d p / d delta_k = (R_world_k delta_k) x arm_k
    arm_k            = sum of R_world_j lever_j over the joints j at or below k

where arm_k is the vector from k to the part of the point that is below k (``p - p_k`` for a joint).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core import rotations as so3
from imocap_core.body.kinematics import Landmark, joint_positions, world_rotations
from imocap_core.body.layouts import layout_points
from imocap_core.body.points import PointSet, rows_of, turn
from imocap_core.conventions import SMPLH_JOINTS
from imocap_core.rotations import for_processor
from imocap_core.workers import compiled


@dataclass(frozen=True, eq=False)
class Model:
    """A skinned body model: y up, facing +z, x to its left, metres.

    Attributes
    ----------
    name, digest: identity of the body; the digest covers every number that moves a vertex.
    joint_names, parents: the J joints of the kinematic tree; joint 0 is the root, of parent -1.
    v_template, faces: the mean surface at rest.
    shapedirs: displacement per unit of each shape coefficient.
    J_regressor: rest joints from rest vertices. weights: skinning weights, rows sum to 1.
    landmarks: named surface points, each a weighted mean of vertices.
    face_parts, part_names: the part of a person to which each face belongs (skin, hair, ...).
    """

    name: str
    joint_names: tuple[str, ...]
    parents: tuple[int, ...]
    v_template: Float[Tensor, "V 3"]
    shapedirs: Float[Tensor, "V 3 B"]
    J_regressor: Float[Tensor, "J V"]
    weights: Float[Tensor, "V J"]
    faces: Int[Tensor, "F 3"]
    digest: str = ""
    landmarks: Mapping[str, Landmark] = field(default_factory=dict)
    face_parts: Int[Tensor, " F"] | None = None
    part_names: tuple[str, ...] = ()

    @property
    def device(self) -> torch.device:
        return self.v_template.device

    @property
    def dtype(self) -> torch.dtype:
        return self.v_template.dtype

    @property
    def num_betas(self) -> int:
        return self.shapedirs.shape[-1]

    @cached_property
    def joints_template(self) -> Float[Tensor, "J 3"]:
        """Rest joints of the mean shape."""
        return self.J_regressor @ self.v_template

    @cached_property
    def joints_shapedirs(self) -> Float[Tensor, "J 3 B"]:
        """Displacement of the rest joints per unit of each shape coefficient."""
        return torch.einsum("jv,vcb->jcb", self.J_regressor, self.shapedirs)

    def shape(self, betas: Float[Tensor, "... n"]) -> Shaped:
        """The body with a shape: at most `num_betas` betas; missing ones are 0.

        ValueError for too many coefficients.
        """
        if betas.shape[-1] > self.num_betas:
            raise ValueError(
                f"betas: expected at most {self.num_betas} coefficients, got {betas.shape[-1]}"
            )
        return Shaped(self, betas)

    def points(self, layout: str) -> PointSet:
        """The keypoints of a layout ("body25", "coco17", "smpl24", ...) on this body."""
        return layout_points(self, layout)


@dataclass(frozen=True, eq=False)
class Shaped:
    """A body with a shape, at rest. coefficients: betas."""

    model: Model
    coefficients: Float[Tensor, "... n"]

    @cached_property
    def joints_rest(self) -> Float[Tensor, "... J 3"]:
        """Rest joints, metres."""
        count = self.coefficients.shape[-1]
        directions = self.model.joints_shapedirs[..., :count]
        offsets = self.coefficients @ directions.flatten(0, 1).T
        return self.model.joints_template + offsets.unflatten(-1, directions.shape[:2])

    @cached_property
    def vertices_rest(self) -> Float[Tensor, "... V 3"]:
        """Rest surface, metres."""
        count = self.coefficients.shape[-1]
        directions = self.model.shapedirs[..., :count]
        offsets = self.coefficients @ directions.flatten(0, 1).T
        return self.model.v_template + offsets.unflatten(-1, directions.shape[:2])

    @cached_property
    def weighted_rest(self) -> Float[Tensor, "... P V"]:
        """Rest vertices from each joint by their skinning weights, and the weights, P = 4 J.

        The same for all poses of a shape, and half of the work of skinning 32 of them.
        """
        weights = self.model.weights
        local = self.vertices_rest[..., None, :] - self.joints_rest[..., None, :, :]
        weighted = (weights[..., None] * local).flatten(-2).transpose(-1, -2)  # (..., 3 J, V)
        offsets = weights.T.expand(*weighted.shape[:-2], -1, -1)
        return torch.cat((weighted, offsets), dim=-2)

    def pose(self, R_local: Float[Tensor, "..."], transl: Float[Tensor, "..."]) -> Posed:
        """The body in a pose.

        R_local (..., J, 3, 3): rotations relative to the parent joint (joint 0: to the world, about
        the pelvis). transl (..., 3): metres, added to everything. ValueError for other shapes.
        """
        joints = len(self.model.parents)
        if R_local.shape[-3:] != (joints, 3, 3):
            raise ValueError(
                f"R_local: expected (..., {joints}, 3, 3) for {self.model.name}, "
                f"got {tuple(R_local.shape)}"
            )
        if transl.shape[-1:] != (3,):
            raise ValueError(f"transl: expected (..., 3), got {tuple(transl.shape)}")
        return Posed(self, R_local, transl, world_rotations(R_local, self.model.parents))


@dataclass(frozen=True, eq=False)
class Posed:
    """A shaped body in a pose, with the world rotations of its joints."""

    shaped: Shaped
    R_local: Float[Tensor, "... J 3 3"]
    transl: Float[Tensor, "... 3"]
    R_world: Float[Tensor, "... J 3 3"]

    @cached_property
    def joints(self) -> Float[Tensor, "... J 3"]:
        """World joints, metres."""
        shaped = self.shaped
        return joint_positions(self.R_world, shaped.joints_rest, self.transl, shaped.model.parents)

    def keypoints(self, points: PointSet) -> Float[Tensor, "... K 3"]:
        """World positions of a layout's keypoints, metres."""
        columns = points.levers(self.shaped.coefficients).flatten(-2).transpose(-1, -2)
        placed = turn(rows_of(self.R_world), columns).transpose(-1, -2)
        root = self.shaped.joints_rest[..., :1, :] + self.transl[..., None, :]
        return placed + root

    def mesh(self) -> Mesh:
        """The skinned surface: needed for pictures and exports, not for fitting."""
        return Mesh(_skin(self), self.shaped.model.faces)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A posed surface, metres."""

    vertices: Float[Tensor, "... V 3"]
    faces: Int[Tensor, "F 3"]


_BODIES_AT_ONCE = 4  # keeps a chunk's 12 numbers a vertex within the processor's cache


def _skin(posed: Posed) -> Float[Tensor, "... V 3"]:
    """Posed vertices, metres: linear blend skinning (Eq. 6). Bone k moves a rest vertex x to
    ``R_k (x - rest_k) + joint_k``; a skinned vertex is the weighted mean over its bones."""
    rest = posed.shaped.joints_rest
    shared = rest.ndim == 2 or (rest.shape[-3] == 1 and posed.R_world.ndim > 3)
    if shared:
        # one matrix product of all bones and weighted vertices
        rows = torch.cat((rows_of(posed.R_world), posed.joints.transpose(-1, -2)), dim=-1)
        return turn(rows, posed.shaped.weighted_rest).transpose(-1, -2)
    return _skin_each(posed)


def _skin_each(posed: Posed) -> Float[Tensor, "... V 3"]:
    """Bodies of different shapes: a few at a time."""
    shaped, model = posed.shaped, posed.shaped.model
    batch = posed.joints.shape[:-2]
    moved_rest = (posed.R_world @ shaped.joints_rest[..., None])[..., 0]
    bones = torch.cat((posed.R_world, (posed.joints - moved_rest)[..., None]), dim=-1)
    bones = bones.expand(*batch, -1, 3, 4).reshape(-1, len(model.parents), 3, 4)
    bones = bones.movedim(1, -1)  # (N, 3, 4, J)
    vertices = shaped.vertices_rest.transpose(-1, -2)
    vertices = vertices.expand(*batch, *vertices.shape[-2:]).reshape(-1, *vertices.shape[-2:])
    done = []
    for first in range(0, len(bones), _BODIES_AT_ONCE):
        part = slice(first, first + _BODIES_AT_ONCE)
        rest = vertices[part]
        blended = bones[part] @ model.weights.T  # (n, 3, 4, V)
        done.append((blended[:, :, :3] * rest[:, None]).sum(2) + blended[:, :, 3])
    return torch.cat(done).transpose(-1, -2).unflatten(0, batch) if batch else done[0][0].T


# The joints of one hand in SMPL+H's order: index, middle, pinky, ring (three each), thumb.
_KNUCKLES = {side: [SMPLH_JOINTS.index(f"{side}_{finger}1") for finger in
             ("index", "middle", "pinky", "ring")] for side in ("left", "right")}  # fmt: skip


def rotations_from_pose(theta: Float[Tensor, "... P"]) -> Float[Tensor, "... J 3 3"]:
    """Axis-angle poses, P = 3 J, radians, to local rotations.

    ValueError when P is not a multiple of 3.
    """
    if theta.shape[-1] % 3:
        raise ValueError(f"theta: expected (..., 3 J) axis-angle, got {tuple(theta.shape)}")
    return so3.exp(theta.unflatten(-1, (-1, 3)))


def pose_from_rotations(R_local: Float[Tensor, "... J 3 3"]) -> Float[Tensor, "... P"]:
    """Local rotations to axis-angle poses, P = 3 J, radians; angles are at most pi."""
    return so3.log(R_local).flatten(-2)


def smplh_from_smpl(R_local: Float[Tensor, "... 24 3 3"]) -> Float[Tensor, "... 52 3 3"]:
    """SMPL poses to SMPL+H poses.

    The four fingers of a hand rotate at their roots like SMPL's hand joint; the thumb is at rest.
    """
    body, (left, right) = R_local[..., :22, :, :], R_local[..., 22:, :, :].unbind(-3)
    identity = torch.eye(3, dtype=R_local.dtype, device=R_local.device).expand_as(left)
    rows = [left if j in _KNUCKLES["left"] else identity for j in range(22, 37)]
    rows += [right if j in _KNUCKLES["right"] else identity for j in range(37, 52)]
    return torch.cat((body, torch.stack(rows, dim=-3)), dim=-3)


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
    xyz, blocks, d_shape = points_with_blocks(shaped.pose(R_local, transl), points)
    return xyz, all_joints(blocks, points), d_shape


def points_with_blocks(
    posed: Posed, points: PointSet
) -> tuple[Float[Tensor, "... K 3"], Float[Tensor, "... N 3 3"], Float[Tensor, "... K 3 n"]]:
    """The same, of derivatives by pose only what may differ from 0: `PointSet.pairs`."""
    shaped, rows = posed.shaped, rows_of(posed.R_world)
    levers = points.levers(shaped.coefficients)
    placed = turn(rows, levers.flatten(-2).transpose(-1, -2)).transpose(-1, -2)
    xyz = placed + shaped.joints_rest[..., :1, :] + posed.transl[..., None, :]
    blocks = _by_pose(posed.R_world, rows, levers, points)
    d_shape = _by_shape(rows, shaped, points)
    batch = xyz.shape[:-2]
    return xyz, blocks.expand(*batch, -1, -1, -1), d_shape.expand(*batch, -1, -1, -1)


def _by_pose(
    R_world: Float[Tensor, "... J 3 3"],
    rows: Float[Tensor, "... 3 _"],
    levers: Float[Tensor, "... K J 3"],
    points: PointSet,
) -> Float[Tensor, "... N 3 3"]:
    """Derivatives by pose of rigid levers."""
    point_of, joint_of = points.pairs
    hanging = levers[..., point_of, :, :] * points.below[joint_of][..., None]
    arm = turn(rows, hanging.flatten(-2).transpose(-1, -2))  # (..., 3, N)
    if for_processor(arm):
        batch = arm.shape[:-2]
        turns = R_world.expand(*batch, *R_world.shape[-3:]).reshape(-1, *R_world.shape[-3:])
        blocks = arm.new_empty(batch.numel(), len(joint_of), 3, 3)
        arrays = (x.contiguous().numpy() for x in (turns, arm.reshape(-1, *arm.shape[-2:])))
        _turn_arms(blocks.numpy(), *arrays, points.spans[1])
        return blocks.view(*batch, *blocks.shape[1:])
    x, y, z = arm.transpose(-1, -2)[..., None].unbind(-2)
    a, b, c = R_world[..., joint_of, :, :].unbind(-2)  # rows of (..., N, 3): the increment's axes
    return torch.stack((b * z - c * y, c * x - a * z, a * y - b * x), dim=-2)


@compiled
def _turn_arms(blocks, R_world, arms, joints):  # type: ignore[no-untyped-def]
    """Derivatives (T, N, 3, 3) of arms (T, 3, N) by increments of their joints: ``(R e) x arm``."""
    for t in range(len(blocks)):
        for n in range(len(joints)):
            x, y, z = arms[t, 0, n], arms[t, 1, n], arms[t, 2, n]
            R, block = R_world[t, joints[n]], blocks[t, n]
            for axis in range(3):
                block[0, axis] = R[1, axis] * z - R[2, axis] * y
                block[1, axis] = R[2, axis] * x - R[0, axis] * z
                block[2, axis] = R[0, axis] * y - R[1, axis] * x


def all_joints(blocks: Float[Tensor, "... N 3 3"], points: PointSet) -> Float[Tensor, "... K 3 P"]:
    """Derivatives of points by all joints, P = 3 J, from those of `PointSet.pairs`."""
    (count, joints), (point_of, joint_of) = points.moved_by.shape, points.pairs
    # Each row of a block is three neighbouring numbers of the result: copy them there.
    axis = torch.arange(3, device=blocks.device)
    place = ((point_of[:, None] * 3 + axis) * joints + joint_of[:, None]).flatten()
    batch = blocks.shape[:-3]
    result = blocks.new_zeros(*batch, count * 3 * joints, 3)
    result.index_copy_(len(batch), place, blocks.flatten(-3, -2))
    return result.view(*batch, count, 3, 3 * joints)


def _by_shape(
    rows: Float[Tensor, "... 3 _"], shaped: Shaped, points: PointSet
) -> Float[Tensor, "... K 3 n"]:
    """Derivatives by shape: levers and the root are linear in the shape."""
    count = shaped.coefficients.shape[-1]
    directions = points.levers_shapedirs[..., :count]  # (K, J, 3, n)
    columns = directions.movedim(0, 2).flatten(2).flatten(0, 1)  # (3 J, K n)
    turned = (rows @ columns).unflatten(-1, (len(points.names), count))
    return turned.transpose(-3, -2) + shaped.model.joints_shapedirs[0, :, :count]
