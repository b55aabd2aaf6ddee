"""Keypoints as levers: joints and surface points without skinning; and the skinning of all.

A point that is a weighted mean of joints and skinned vertices is

    p = root + sum_k R_world_k @ lever_k,        root = joints_rest[0] + transl

where lever_k, a vector in the frame of joint k, is linear in the shape. It is the sum of the
surface vertices that joint k moves, by their weights, and of its bones towards the joints below
that move the rest.
So a layout on any number of bodies is one matrix product, and so are its derivatives.

Linear blend skinning of the whole surface (SMPL, Eq. 6 of Loper et al. 2015). Bone k moves a rest
vertex x to ``R_k (x - rest_k) + joint_k``; a skinned vertex is the weighted mean over its bones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from imocap_core.body.kinematics import ModelArrays, PosedArrays, ShapedArrays, ancestors


@dataclass(frozen=True, eq=False)
class PointSet:
    """K named points on one model.

    Attributes
    ----------
    names, columns: names and columns of the layout. Columns are 0 to K - 1 unless the layout has
        keypoints that the body does not have: compare with ``xy[..., list(columns), :]``.
    levers_template, levers_shapedirs: metres, and per unit of each shape coefficient.
    moved_by: whether the rotation of a joint moves the point.
    below: below[k, j] is 1 where joint j is k or a descendant of k, else 0.
    """

    names: tuple[str, ...]
    levers_template: Float[Tensor, "K J 3"]
    levers_shapedirs: Float[Tensor, "K J 3 B"]
    moved_by: Bool[Tensor, "K J"]
    below: Float[Tensor, "J J"]
    columns: tuple[int, ...]

    @cached_property
    def pairs(self) -> tuple[Int[Tensor, " N"], Int[Tensor, " N"]]:
        """Point and joint of each pair of which the joint moves the point, sorted by points."""
        point_of, joint_of = self.moved_by.nonzero(as_tuple=True)
        return point_of, joint_of

    @cached_property
    def spans(self) -> tuple[Int[np.ndarray, " K1"], Int[np.ndarray, " N"]]:
        """For compiled loops: starts, point k has pairs ``starts[k] : starts[k + 1]``; joints."""
        point_of, joint_of = (x.cpu().numpy() for x in self.pairs)
        return np.searchsorted(point_of, np.arange(len(self.names) + 1)), joint_of

    def levers(self, shaped: ShapedArrays) -> Float[Tensor, "... K J 3"]:
        """Levers of a shape."""
        count = shaped.coefficients.shape[-1]
        directions = self.levers_shapedirs[..., :count]
        offsets = shaped.coefficients @ directions.flatten(0, -2).T
        return self.levers_template + offsets.unflatten(-1, self.levers_template.shape)


def pick_points(points: PointSet, names: Sequence[str]) -> PointSet:
    """A subset of the points, by name."""
    rows = [points.names.index(name) for name in names]
    return replace(
        points,
        names=tuple(names),
        levers_template=points.levers_template[rows],
        levers_shapedirs=points.levers_shapedirs[rows],
        moved_by=points.moved_by[rows],
        columns=tuple(points.columns[row] for row in rows),
    )


def make_points(
    model: ModelArrays,
    names: Sequence[str],
    joint_shares: Sequence[Mapping[int, float]],
    vertex_shares: Sequence[Mapping[int, float]],
) -> PointSet:
    """Points as weighted means: for each point, weights of joints and weights of vertices.

    Raises ValueError for points whose weights do not sum to 1 (they would not move with the body).
    """
    joints, vertices = (
        _table(joint_shares, len(model.parents)),
        sorted({v for shares in vertex_shares for v in shares}),
    )
    shares = torch.zeros(len(names), len(vertices), dtype=torch.float64)
    for row, mix in enumerate(vertex_shares):
        for vertex, share in mix.items():
            shares[row, vertices.index(vertex)] += share
    total = joints.sum(1) + shares.sum(1)
    wrong = [
        name for name, value in zip(names, total.tolist(), strict=True) if abs(value - 1) > 1e-6
    ]
    if wrong:
        raise ValueError(f"points {wrong}: the weights of each point must sum to 1")
    return _build(model, tuple(names), joints.to(model.v_template), shares, vertices)


def join_points(sets: Sequence[PointSet]) -> PointSet:
    """Several sets of points on one model as one, in order; `columns` are those of each layout."""
    if not sets:
        raise ValueError("join_points: expected at least one set of points")
    if len(sets) == 1:
        return sets[0]
    return PointSet(
        names=tuple(name for points in sets for name in points.names),
        levers_template=torch.cat([points.levers_template for points in sets]),
        levers_shapedirs=torch.cat([points.levers_shapedirs for points in sets]),
        moved_by=torch.cat([points.moved_by for points in sets]),
        below=sets[0].below,
        columns=tuple(column for points in sets for column in points.columns),
    )


def _table(rows: Sequence[Mapping[int, float]], width: int) -> Float[Tensor, "K J"]:
    table = torch.zeros(len(rows), width, dtype=torch.float64)
    for row, mix in enumerate(rows):
        for column, share in mix.items():
            table[row, column] += share
    return table


def _build(
    model: ModelArrays,
    names: tuple[str, ...],
    joint_shares: Float[Tensor, "K J"],
    shares: Float[Tensor, "K U"],
    vertices: list[int],
) -> PointSet:
    weights = model.weights[vertices]  # (U, J)
    shares = shares.to(weights)
    by_joint = joint_shares + shares @ weights  # (K, J): share of the point that each joint moves
    chain = ancestors(model.parents).to(weights)
    below = by_joint @ chain  # (K, J): share that a joint or its descendants move
    vertex_shares = torch.einsum("ku,uj->kuj", shares, weights)

    def levers(
        vertex: Float[Tensor, "U 3 n"], joint: Float[Tensor, "J 3 n"]
    ) -> Float[Tensor, "K J 3 n"]:
        lever = torch.einsum("kuj,ucn->kjcn", vertex_shares, vertex)
        lever = lever - (shares @ weights)[..., None, None] * joint
        for child, parent in enumerate(model.parents[1:], start=1):
            bone = joint[child] - joint[parent]
            lever[:, parent] += below[:, child, None, None] * bone
        return lever

    return PointSet(
        names,
        levers(model.v_template[vertices][..., None], model.joints_template[..., None])[..., 0],
        levers(model.shapedirs[vertices], model.joints_shapedirs),
        _moved_by(model.parents, joint_shares, shares @ weights),
        chain.T,
        tuple(range(len(names))),
    )


def _moved_by(
    parents: Sequence[int], joint_shares: Float[Tensor, "K J"], skinned: Float[Tensor, "K J"]
) -> Bool[Tensor, "K J"]:
    """Whether the rotation of a joint moves a point. A joint is moved by its ancestors; a skinned
    vertex also by the joints of its weights."""
    chain = ancestors(parents).to(joint_shares)
    strictly_above = chain - torch.eye(len(parents), dtype=chain.dtype, device=chain.device)
    return (joint_shares.abs() @ strictly_above + skinned.abs() @ chain) > 0


def rows_of(R_world: Float[Tensor, "... J 3 3"]) -> Float[Tensor, "... 3 P"]:
    """World rotations side by side, P = 3 J, for multiplication with levers."""
    return R_world.transpose(-3, -2).flatten(-2)


def turn(
    rows: Float[Tensor, "... 3 P"], columns: Float[Tensor, "... P Q"]
) -> Float[Tensor, "... 3 Q"]:
    """Matrix product, as few and as large products as possible.

    Poses that share one shape (columns broadcast along the last leading axis) are stacked into
    one tall product instead of many small ones.
    """
    shared = columns.ndim > 2 and columns.shape[-3] == 1 and rows.ndim > 2
    if not shared:
        return rows @ columns
    stacked = rows.flatten(-3, -2) @ columns.squeeze(-3)
    return stacked.unflatten(-2, (-1, 3))


def place_points(posed: PosedArrays, points: PointSet) -> Float[Tensor, "... K 3"]:
    """World positions of the points, metres."""
    columns = points.levers(posed.shaped).flatten(-2).transpose(-1, -2)
    placed = turn(rows_of(posed.R_world), columns).transpose(-1, -2)
    root = posed.shaped.joints_rest[..., :1, :] + posed.transl[..., None, :]
    return placed + root


_BODIES_AT_ONCE = 4  # keeps a chunk's 12 numbers a vertex within the processor's cache


def skin(posed: PosedArrays) -> Float[Tensor, "... V 3"]:
    """Posed vertices, metres."""
    rest = posed.shaped.joints_rest
    shared = rest.ndim == 2 or (rest.shape[-3] == 1 and posed.R_world.ndim > 3)
    if shared:
        # one matrix product of all bones and weighted vertices
        rows = torch.cat((rows_of(posed.R_world), posed.joints.transpose(-1, -2)), dim=-1)
        return turn(rows, posed.shaped.weighted_rest).transpose(-1, -2)
    return _skin_each(posed)


def weighted_rest(shaped: ShapedArrays) -> Float[Tensor, "... P V"]:
    """Rest vertices from each joint by their skinning weights, and the weights, P = 4 J.

    The same for all poses of a shape, and half of the work of skinning 32 of them.
    """
    weights = shaped.model.weights
    local = shaped.vertices_rest[..., None, :] - shaped.joints_rest[..., None, :, :]
    weighted = (weights[..., None] * local).flatten(-2).transpose(-1, -2)  # (..., 3 J, V)
    offsets = weights.T.expand(*weighted.shape[:-2], -1, -1)
    return torch.cat((weighted, offsets), dim=-2)


def _skin_each(posed: PosedArrays) -> Float[Tensor, "... V 3"]:
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
