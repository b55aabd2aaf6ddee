"""The SMPL body model as immutable values: Model -> Shaped -> Posed -> Mesh.

Each value adds a shape, a pose or a surface to the one before and refers to it, so nothing is
computed twice and nothing can be out of date. All arrays are torch tensors of one device and
dtype; leading axes broadcast, e.g. betas (M, 1, 10) with R_local (M, T, 24, 3, 3). Model and
formulas: Loper et al., "SMPL", SIGGRAPH Asia 2015.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core.body.kinematics import check_tree, joint_positions, world_rotations
from imocap_core.body.layouts import layout_points
from imocap_core.body.points import PointSet, place_points
from imocap_core.body.protocols import Landmark
from imocap_core.body.skinning import skin, weighted_rest


@dataclass(frozen=True, eq=False)
class Model:
    """A skinned body model: y up, facing +z, x to its left, metres.

    Attributes
    ----------
    name, digest: identity of the body; the digest covers every number that moves a vertex.
    joint_names, parents: the J joints of the kinematic tree; joint 0 is the root, of parent -1.
    v_template, faces: the mean surface at rest.
    shapedirs: displacement per unit of each shape coefficient. The first `num_betas` are the
        person's shape, the rest (SMPL-X) facial expression.
    posedirs: pose blend shapes, per entry of ``R_local[1:] - I``: P = 9 (J - 1).
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
    num_betas: int = 10
    posedirs: Float[Tensor, "V 3 P"] | None = None
    landmarks: Mapping[str, Landmark] = field(default_factory=dict)
    face_parts: Int[Tensor, " F"] | None = None
    part_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the shapes of the arrays; ValueError names every one that does not fit."""
        check_tree(self.parents)
        vertices, joints = self.v_template.shape[0], len(self.parents)
        expected: dict[str, tuple[int, ...]] = {
            "v_template": (vertices, 3),
            "shapedirs": (vertices, 3, self.shapedirs.shape[-1]),
            "J_regressor": (joints, vertices),
            "weights": (vertices, joints),
            "faces": (self.faces.shape[0], 3),
        }
        if self.posedirs is not None:
            expected["posedirs"] = (vertices, 3, 9 * (joints - 1))
        if self.face_parts is not None:
            expected["face_parts"] = (self.faces.shape[0],)
        wrong = [
            f"{name} is {tuple(getattr(self, name).shape)}, expected {shape}"
            for name, shape in expected.items()
            if tuple(getattr(self, name).shape) != shape
        ]
        if len(self.joint_names) != joints:
            wrong.append(f"{len(self.joint_names)} joint names, expected {joints}")
        if wrong:
            raise ValueError(f"body model {self.name}: " + "; ".join(wrong))

    @property
    def device(self) -> torch.device:
        return self.v_template.device

    @property
    def dtype(self) -> torch.dtype:
        return self.v_template.dtype

    @cached_property
    def joints_template(self) -> Float[Tensor, "J 3"]:
        """Rest joints of the mean shape."""
        return self.J_regressor @ self.v_template

    @cached_property
    def joints_shapedirs(self) -> Float[Tensor, "J 3 B"]:
        """Displacement of the rest joints per unit of each shape coefficient."""
        return torch.einsum("jv,vcb->jcb", self.J_regressor, self.shapedirs)

    def shape(
        self, betas: Float[Tensor, "... n"], expression: Float[Tensor, "... m"] | None = None
    ) -> Shaped:
        """The body with a shape: at most `num_betas` betas; missing ones are 0.

        expression: facial expression of bodies that have it (SMPL-X). ValueError for too many
        coefficients.
        """
        expressions = self.shapedirs.shape[-1] - self.num_betas
        if betas.shape[-1] > self.num_betas:
            raise ValueError(
                f"betas: expected at most {self.num_betas} coefficients, got {betas.shape[-1]}"
            )
        if expression is None:
            return Shaped(self, betas)
        if expression.shape[-1] > expressions:
            raise ValueError(
                f"expression: {self.name} has {expressions} coefficients, "
                f"got {expression.shape[-1]}"
            )
        leading = torch.broadcast_shapes(betas.shape[:-1], expression.shape[:-1])
        padding = betas.new_zeros(*leading, self.num_betas - betas.shape[-1])
        parts = (betas.expand(*leading, -1), padding, expression.expand(*leading, -1))
        return Shaped(self, torch.cat(parts, dim=-1))

    def points(self, layout: str) -> PointSet:
        """The keypoints of a layout ("body25", "coco17", "smpl24", ...) on this body."""
        return layout_points(self, layout)


@dataclass(frozen=True, eq=False)
class Shaped:
    """A body with a shape, at rest. coefficients: betas, then expression."""

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
        """Rest surface, metres, before pose blend shapes."""
        count = self.coefficients.shape[-1]
        directions = self.model.shapedirs[..., :count]
        offsets = self.coefficients @ directions.flatten(0, 1).T
        return self.model.v_template + offsets.unflatten(-1, directions.shape[:2])

    @cached_property
    def weighted_rest(self) -> Float[Tensor, "... P V"]:
        """What skinning multiplies with poses, see `skinning.weighted_rest`."""
        return weighted_rest(self)

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
        return place_points(self, points)

    def mesh(self) -> Mesh:
        """The skinned surface: needed for pictures and exports, not for fitting."""
        return Mesh(skin(self), self.shaped.model.faces)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A posed surface, metres."""

    vertices: Float[Tensor, "... V 3"]
    faces: Int[Tensor, "F 3"]
