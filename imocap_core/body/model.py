"""The body as immutable values: Model -> Shaped -> Posed -> Mesh.

Each stage adds one thing (a shape, a pose, a surface) and keeps what came before, so nothing is
computed twice and nothing can be out of date. All arrays are torch tensors of one device and
dtype; everything broadcasts over leading axes, e.g. betas (M, 1, 10) with R_local
(M, T, 24, 3, 3). Model and formulas: Loper et al., "SMPL", SIGGRAPH Asia 2015.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from imocap_core.body.kinematics import check_tree, joint_positions, world_rotations
from imocap_core.body.layouts import layout_points
from imocap_core.body.points import PointSet, place_points
from imocap_core.body.protocols import Landmark
from imocap_core.body.skinning import skin


@dataclass(frozen=True, eq=False)
class Model:
    """A skinned body: y up, facing +z, x to its left, metres.

    Attributes
    ----------
    name, digest: which body this is; the digest covers every number that moves a vertex.
    joint_names (J), parents (J): the joint tree; joint 0 is the root, of parent -1.
    v_template (V, 3), faces (F, 3): the mean surface at rest.
    shapedirs (V, 3, B): displacement per unit of each shape coefficient. The first `num_betas`
        are the person's shape, the rest (SMPL-X) facial expression.
    posedirs (V, 3, 9 (J - 1)) or None: pose blend shapes, per entry of ``R_local[1:] - I``.
    J_regressor (J, V): rest joints from rest vertices. weights (V, J): skinning, rows sum to 1.
    landmarks: named surface points, each a weighted mix of vertices.
    face_parts (F,), part_names: which part of a person a face shows (skin, hair, shirt, ...).
    hand_pca: (mean (45,), components (45, 45)) of "left" and "right" axis-angle hand poses.
    """

    name: str
    joint_names: tuple[str, ...]
    parents: tuple[int, ...]
    v_template: Tensor
    shapedirs: Tensor
    J_regressor: Tensor
    weights: Tensor
    faces: Tensor
    digest: str = ""
    num_betas: int = 10
    posedirs: Tensor | None = None
    landmarks: Mapping[str, Landmark] = field(default_factory=dict)
    face_parts: Tensor | None = None
    part_names: tuple[str, ...] = ()
    hand_pca: Mapping[str, tuple[Tensor, Tensor]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that the arrays belong together; ValueError names every one that does not."""
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
    def joints_template(self) -> Tensor:
        """Rest joints (J, 3) of the mean shape."""
        return self.J_regressor @ self.v_template

    @cached_property
    def joints_shapedirs(self) -> Tensor:
        """(J, 3, B): how rest joints move per unit of each shape coefficient."""
        return torch.einsum("jv,vcb->jcb", self.J_regressor, self.shapedirs)

    def shape(self, betas: Tensor, expression: Tensor | None = None) -> Shaped:
        """Give the body a shape: betas (..., n), n at most `num_betas`; missing ones are 0.

        expression (..., m): facial expression of bodies that have it (SMPL-X).
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
    """A body of a certain shape, at rest. coefficients (..., n): betas, then expression."""

    model: Model
    coefficients: Tensor

    @cached_property
    def joints_rest(self) -> Tensor:
        """Rest joints (..., J, 3), metres."""
        count = self.coefficients.shape[-1]
        directions = self.model.joints_shapedirs[..., :count]
        offsets = self.coefficients @ directions.flatten(0, 1).T
        return self.model.joints_template + offsets.unflatten(-1, directions.shape[:2])

    @cached_property
    def vertices_rest(self) -> Tensor:
        """Rest surface (..., V, 3), metres, before pose blend shapes."""
        count = self.coefficients.shape[-1]
        directions = self.model.shapedirs[..., :count]
        offsets = self.coefficients @ directions.flatten(0, 1).T
        return self.model.v_template + offsets.unflatten(-1, directions.shape[:2])

    def pose(self, R_local: Tensor, transl: Tensor) -> Posed:
        """Pose it: R_local (..., J, 3, 3) rotations relative to the parent joint (joint 0: to the
        world, about the pelvis), transl (..., 3) metres added to everything.
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
    """A shaped body in a pose; R_world (..., J, 3, 3) are the joints' world rotations."""

    shaped: Shaped
    R_local: Tensor
    transl: Tensor
    R_world: Tensor

    @cached_property
    def joints(self) -> Tensor:
        """World joints (..., J, 3), metres."""
        shaped = self.shaped
        return joint_positions(self.R_world, shaped.joints_rest, self.transl, shaped.model.parents)

    def keypoints(self, points: PointSet) -> Tensor:
        """World positions (..., K, 3) of a layout's keypoints, metres."""

        return place_points(self, points)

    def mesh(self) -> Mesh:
        """Skin the whole surface: never needed to fit, only to look at."""

        return Mesh(skin(self), self.shaped.model.faces)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A posed surface: vertices (..., V, 3) in metres, faces (F, 3)."""

    vertices: Tensor
    faces: Tensor
