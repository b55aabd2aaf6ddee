"""Keypoints as levers: joints and surface points without skinning.

A point that is a weighted mean of joints and skinned vertices is

    p = root + sum_k R_world_k @ lever_k,        root = joints_rest[0] + transl

where lever_k, a vector in the frame of joint k, is linear in the shape. It is the sum of the
surface vertices that joint k moves, by their weights, and of its bones towards the joints below
that move the rest.
So a layout on any number of bodies is one matrix product, and so are its derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from imocap_core.body.kinematics import Landmark, ancestors

if TYPE_CHECKING:

    class ModelArrays(Protocol):
        """Arrays of `Model`, whose file imports this one."""

        @property
        def name(self) -> str: ...
        @property
        def joint_names(self) -> tuple[str, ...]: ...
        @property
        def parents(self) -> tuple[int, ...]: ...
        @property
        def v_template(self) -> Tensor: ...
        @property
        def shapedirs(self) -> Tensor: ...
        @property
        def weights(self) -> Tensor: ...
        @property
        def landmarks(self) -> Mapping[str, Landmark]: ...
        @property
        def joints_template(self) -> Tensor: ...
        @property
        def joints_shapedirs(self) -> Tensor: ...

else:  # to check an instance against a protocol would compute all its cached arrays
    ModelArrays = Any


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

    def levers(self, coefficients: Float[Tensor, "... n"]) -> Float[Tensor, "... K J 3"]:
        """Levers of a shape."""
        directions = self.levers_shapedirs[..., : coefficients.shape[-1]]
        offsets = coefficients @ directions.flatten(0, -2).T
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
    joints = _table(joint_shares, len(model.parents))
    vertices = sorted({v for shares in vertex_shares for v in shares})
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
