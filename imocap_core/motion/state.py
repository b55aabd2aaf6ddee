"""The solver's unknowns, the keypoints and joints of the body for them, and their mirror images.

A video that was filmed in a mirror, or flipped, shows left and right swapped. Its mirror image is
taken in the axes of its own camera, x -> -x with S = diag(-1, 1, 1), so that pictures are reflected
about the principal point. Every function for this is its own inverse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from imocap_core import rotations
from imocap_core.body import (
    Model,
    PointSet,
    Posed,
    all_joints,
    join_points,
    pick_points,
    points_with_blocks,
)
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.rotations import exp, log
from imocap_core.workers import compiled

POSE = 72
FRAME_UNKNOWNS = POSE + 3

T = TypeVar("T")


@dataclass(frozen=True)
class MotionState:
    """A batch of B motions of T frames, each in its own camera's axes or in the world's.

    Attributes:
        R_local: (B, T, 24, 3, 3) joint rotations relative to the parent; joint 0 is global.
        trans: (B, T, 3) metres, SMPL's translation.
        betas: (B, 10) shape.
        valid: (B, T) bool; False pads shorter motions; padding adds to no cost.
        camera_R: (B, C, 3, 3), camera_t: (B, C, 3) free cameras from the state's axes; C may be 0.
        log_focal: (B, F) free focal lengths, logarithms over those of their views; F may be 0.
        other_betas: (B, P - 1, 10) shapes of P performers but the first, whose is ``betas``.
        scores: (B, V, k) of V performances in k modes of variation (`multiview.modes`).
    """

    R_local: Float[Tensor, "B T 24 3 3"]
    trans: Float[Tensor, "B T 3"]
    betas: Float[Tensor, "B 10"]
    valid: Bool[Tensor, "B T"]
    camera_R: Float[Tensor, "B C 3 3"]
    camera_t: Float[Tensor, "B C 3"]
    log_focal: Float[Tensor, "B F"]
    other_betas: Float[Tensor, "B p 10"]
    scores: Float[Tensor, "B V k"]

    @classmethod
    def of(
        cls,
        R_local: Float[Tensor, "B T 24 3 3"],
        trans: Float[Tensor, "B T 3"],
        betas: Float[Tensor, "B 10"],
        valid: Bool[Tensor, "B T"],
    ) -> MotionState:
        """A state without free cameras."""
        none = trans.new_zeros(len(trans), 0, 3)
        no_rotation, no_focal = none[..., None].expand(-1, 0, 3, 3), none[..., 0]
        no_other = betas.new_zeros(len(betas), 0, betas.shape[1])
        free = no_rotation, none, no_focal, no_other, none[..., :0]
        return cls(R_local, trans, betas, valid, *free)

    def cached(self, owners: tuple[object, ...], make: Callable[[], T]) -> T:
        """What ``owners`` compute from this state, computed at the first request.

        A step is tried, its cost evaluated, and the equations of the next step are set up at the
        same state: what both need (poses, rigid offsets) is computed once. It lives as long as the
        state.
        """
        key = tuple(id(owner) for owner in owners)
        entry = self._cache.get(key)
        if entry is None:  # owners are part of the entry, so that their ids stay theirs
            entry = self._cache[key] = (owners, make())
        value: T = entry[1]
        return value

    def uncached(self) -> MotionState:
        """The same state without what was computed from it, for uses that should not add to it."""
        return replace(self)

    def forget(self) -> None:
        """Drop what was computed from this state: it is computed again where it is wanted."""
        self._cache.clear()
        self._bodies.clear()

    @cached_property
    def _cache(self) -> dict[tuple[int, ...], tuple[tuple[object, ...], Any]]:
        return {}

    @cached_property
    def axis_angle(self) -> Float[Tensor, "B T 24 3"]:
        """Joint rotations as vectors, radians."""
        return log(self.R_local)

    @property
    def unknown_globals(self) -> int:
        """Number of unknowns that all frames share: 10 of shape, 6 a camera, 1 a focal length, 10
        of every other performer's shape, 1 a score."""
        return sum(self._global_sizes)

    @property
    def _global_sizes(self) -> list[int]:
        cameras, focal_lengths = 6 * self.camera_t.shape[1], self.log_focal.shape[1]
        return [
            self.betas.shape[1],
            cameras,
            focal_lengths,
            self.other_betas.shape[1] * self.betas.shape[1],
            self.scores[0].numel(),
        ]

    def camera_columns(self, camera: int) -> slice:
        """Indices of a free camera's (rotation, translation) among the globals."""
        start = self.betas.shape[1] + 6 * camera
        return slice(start, start + 6)

    def focal_column(self, focal: int) -> int:
        """Index of a free focal length among the globals."""
        return self.betas.shape[1] + 6 * self.camera_t.shape[1] + focal

    def score_columns(self, performance: int) -> slice:
        """Indices of a performance's scores among the globals."""
        modes = self.scores.shape[2]
        start = sum(self._global_sizes[:4]) + performance * modes
        return slice(start, start + modes)

    def of_frames(self, frames: slice) -> MotionState:
        """Some frames of every motion."""
        parts = {name: getattr(self, name)[:, frames] for name in ("R_local", "trans", "valid")}
        return replace(self, **parts)

    def shape_columns(self, performer: int = 0) -> slice:
        """Indices of a performer's shape among the globals."""
        count = self.betas.shape[1]
        if performer == 0:
            return slice(0, count)
        start = sum(self._global_sizes[:3]) + (performer - 1) * count
        return slice(start, start + count)

    def of_performer(self, performer: int) -> MotionState:
        """The motion with a performer's shape in place of the first one's."""
        if performer == 0:
            return self
        return self._bodies.setdefault(
            performer, replace(self, betas=self.other_betas[:, performer - 1])
        )

    @cached_property
    def _bodies(self) -> dict[int, MotionState]:
        return {}

    def retract(
        self, d_frames: Float[Tensor, "B T 75"], d_globals: Float[Tensor, "B m"]
    ) -> MotionState:
        """The state after local increments.

        Joints: ``R <- R exp(delta)``. Cameras: ``R <- exp(rotation) R``, ``t <- t + translation``,
        the rotation about the mean of the root path, which keeps both nearly independent.
        """
        d_frames = torch.where(self.valid[..., None], d_frames, 0.0)
        delta = d_frames[..., :POSE].reshape(*self.R_local.shape[:-2], 3)
        changes = d_globals.split(self._global_sizes, dim=1)
        d_betas, d_cameras, d_focal, d_other, d_scores = changes
        change = d_cameras.reshape(*self.camera_t.shape[:2], 6)
        turned = exp(change[..., :3]) @ self.camera_R
        before, after = (
            torch.einsum("bcij,bj->bci", R, self.pivot()) for R in (self.camera_R, turned)
        )
        return replace(
            self,
            R_local=self.R_local @ exp(delta),
            trans=self.trans + d_frames[..., POSE:],
            betas=self.betas + d_betas,
            camera_R=turned,
            camera_t=self.camera_t + change[..., 3:] + before - after,
            log_focal=self.log_focal + d_focal,
            other_betas=self.other_betas + d_other.view_as(self.other_betas),
            scores=self.scores + d_scores.view_as(self.scores),
        )

    def pivot(self) -> Float[Tensor, "B 3"]:
        """Mean of the root path: the point about which cameras rotate."""
        total = self.valid.sum(1, keepdim=True).clamp_min(1)
        return torch.where(self.valid[..., None], self.trans, 0.0).sum(1) / total

    def rows(self, index: Int[Tensor, " R"]) -> MotionState:
        """Some motions of the batch."""
        return MotionState(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def of_motion(self, v: int, frames: int) -> MotionState:
        """The first frames of motion ``v`` as a batch of 1."""
        row = self.rows(torch.tensor([v], device=self.valid.device))
        return replace(
            row,
            R_local=row.R_local[:, :frames],
            trans=row.trans[:, :frames],
            valid=row.valid[:, :frames],
        )


FEET = ("left_ankle", "right_ankle", "left_foot", "right_foot")
MOVING = (
    *(f"{side}_{end}" for end in ("hip", "knee", "ankle") for side in ("left", "right")),
    *(f"{side}_{end}" for end in ("shoulder", "elbow", "wrist") for side in ("left", "right")),
    "head",
)


@dataclass(frozen=True)
class MovedPoints:
    """Positions of K points and their derivatives J.

    A point moves with its joint's ancestors: compiled loops run over these pairs, a card multiplies
    whole matrices.

    Attributes:
        xyz: (B, T, K, 3) metres; points: their names and pairs.
        blocks: (B, T, N, 3, 3) by the local increments, of `PointSet.pairs`.
        d_beta: (B, T, K, 3, 10).
    """

    xyz: Float[Tensor, "B T K 3"]
    points: PointSet
    blocks: Float[Tensor, "B T N 3 3"]
    d_beta: Float[Tensor, "B T K 3 10"]

    @cached_property
    def d_pose(self) -> Float[Tensor, "B T K 3 72"]:
        """By the local increments of all joints."""
        return all_joints(self.blocks, self.points)

    def of_frames(self, frames: slice) -> MovedPoints:
        """Some frames of every motion."""
        parts = {name: getattr(self, name)[:, frames] for name in ("xyz", "blocks", "d_beta")}
        return replace(self, **parts)

    def add_products(
        self,
        target: Float[Tensor, "B T n n"],
        later: MovedPoints,
        metric: Float[Tensor, "B T K 3 3"],
    ) -> None:
        """Add ``J^T metric J'`` in place, with the derivatives J' of ``later``.

        Args:
            target: of all unknowns of a frame, or of the pose alone.
        """
        moves = target.shape[-1] == FRAME_UNKNOWNS
        if not rotations.for_processor(target):
            left, right = (x.by_frame(moves) for x in (self, later))
            target += left.flatten(2, 3).mT @ (metric @ right).flatten(2, 3)
            return
        arrays = (target, self.blocks, later.blocks, metric)
        for motion in zip(*(x.numpy() for x in arrays), strict=True):
            _add_products(*motion, *self.points.spans, moves)

    def pulled(self, values: Float[Tensor, "B T K 3 m"]) -> Float[Tensor, "B T 75 m"]:
        """``J^T values``."""
        if not rotations.for_processor(values):
            return self.by_frame(True).flatten(2, 3).mT @ values.flatten(2, 3)
        sums = values.new_zeros(*values.shape[:2], FRAME_UNKNOWNS, values.shape[-1])
        for motion in zip(*(x.numpy() for x in (sums, self.blocks, values)), strict=True):
            _add_pulled(*motion, *self.points.spans)
        return sums

    def by_frame(self, moves: bool) -> Float[Tensor, "B T K 3 n"]:
        """Derivatives by the pose, and where the points move with it by the translation."""
        place = torch.eye(3).to(self.xyz).expand(*self.xyz.shape, 3)
        return torch.cat([self.d_pose, place], -1) if moves else self.d_pose


@compiled
def _add_products(target, left, right, metric, starts, joints, moves):  # type: ignore[no-untyped-def]
    """`MovedPoints.add_products` of one motion: row by row of the unknowns that move a point."""
    most = 3 * (np.diff(starts).max() + 1)
    L, R, columns = np.zeros((3, most)), np.zeros((3, most)), np.empty(most, np.uintp)
    for t in range(len(target)):
        for k in range(len(starts) - 1):
            width, square = 3 * (starts[k + 1] - starts[k]), metric[t, k]
            for c in range(width):
                pair, axis = starts[k] + c // 3, c % 3
                columns[c] = 3 * joints[pair] + axis
                x, y, z = right[t, pair, 0, axis], right[t, pair, 1, axis], right[t, pair, 2, axis]
                for r in range(3):
                    L[r, c] = left[t, pair, r, axis]
                    R[r, c] = square[r, 0] * x + square[r, 1] * y + square[r, 2] * z
            if moves:
                for axis in range(3):
                    columns[width + axis] = target.shape[1] - 3 + axis
                    for r in range(3):
                        L[r, width + axis] = r == axis
                        R[r, width + axis] = square[r, axis]
                width += 3
            for i in range(width):
                x, y, z, row = L[0, i], L[1, i], L[2, i], target[t, columns[i]]
                for c in range(width):
                    row[columns[c]] += x * R[0, c] + y * R[1, c] + z * R[2, c]


@compiled
def _add_pulled(sums, blocks, values, starts, joints):  # type: ignore[no-untyped-def]
    """`MovedPoints.pulled` of one motion."""
    width, columns = sums.shape[1:]
    for t in range(len(sums)):
        for k in range(len(starts) - 1):
            for i in range(3):
                for c in range(columns):
                    sums[t, width - 3 + i, c] += values[t, k, i, c]
            for a in range(starts[k], starts[k + 1]):
                for i in range(3):
                    x, y, z = blocks[t, a, 0, i], blocks[t, a, 1, i], blocks[t, a, 2, i]
                    for c in range(columns):
                        pull = x * values[t, k, 0, c] + y * values[t, k, 1, c]
                        sums[t, 3 * joints[a] + i, c] += pull + z * values[t, k, 2, c]


@dataclass(frozen=True)
class Body:
    """A body model with the keypoints of one layout, the 24 joints, and some of them: those of the
    feet, and those that move by themselves (limbs and head)."""

    model: Model
    keypoints: PointSet
    joints: PointSet
    feet: PointSet
    moving: PointSet

    @classmethod
    def of(cls, model: Model, *layouts: str) -> Body:
        """The model with the keypoints of one or several layouts, one after another."""
        joints = model.points("smpl24")
        keypoints = join_points([model.points(x) for x in layouts])
        feet, moving = pick_points(joints, FEET), pick_points(joints, MOVING)
        return cls(model, keypoints, joints, feet, moving)

    def posed(self, state: MotionState) -> Posed:
        """The body in the state's shape and poses."""

        def pose() -> Posed:
            return self.model.shape(state.betas[:, None]).pose(state.R_local, state.trans)

        return state.cached((self.model,), pose)

    def positions(self, points: PointSet, state: MotionState) -> Float[Tensor, "B T K 3"]:
        """Positions only, metres."""
        posed = self.posed(state)
        return state.cached((self.model, points), lambda: posed.keypoints(points))

    def derivatives(
        self, points: PointSet, state: MotionState, frames: slice = slice(None)
    ) -> MovedPoints:
        """Positions and their derivatives, of some frames."""
        posed = self.posed(state)
        moving = (x[:, frames] for x in (posed.R_local, posed.transl, posed.R_world))
        xyz, blocks, d_beta = points_with_blocks(Posed(posed.shaped, *moving), points)
        return MovedPoints(xyz, points, blocks.contiguous(), d_beta)


REFLECTION = np.array([-1.0, 1.0, 1.0])
TWINS = list(mirror_indices(SMPL_JOINTS))


def mirrored_pose(theta: Float[np.ndarray, "T 72"]) -> Float[np.ndarray, "T 72"]:
    """Axis-angle poses in a mirror: R -> S R S for each joint's twin."""
    vectors = theta.reshape(-1, 24, 3)[:, TWINS] * -REFLECTION  # axes of rotation turn too
    return vectors.reshape(-1, 72)


def mirrored_translation(
    trans: Float[np.ndarray, "T 3"], root_rest: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "T 3"]:
    """SMPL translations of the mirror image; root_rest: the resting root joint of the shape."""
    return (root_rest + trans) * REFLECTION - root_rest


def mirrored_joints(joints: Float[np.ndarray, "... 24 3"]) -> Float[np.ndarray, "... 24 3"]:
    """SMPL's joints in a mirror, left and right swapped."""
    return joints[..., TWINS, :] * REFLECTION


def mirrored_covariance(
    covariance: Float[np.ndarray, "... 24 3 3"],
) -> Float[np.ndarray, "... 24 3 3"]:
    """Covariances of SMPL's joints in a mirror: S C S of each joint's twin."""
    return covariance[..., TWINS, :, :] * REFLECTION[:, None] * REFLECTION


def mirrored_extrinsics(
    R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """The camera that films the mirror image of the world: S R S, S t; its intrinsics stay."""
    return REFLECTION[:, None] * R * REFLECTION, REFLECTION * t


def mirrored_pixels(
    xy_px: Float[np.ndarray, "T K 2"], K: Float[np.ndarray, "3 3"], twins: Sequence[int]
) -> Float[np.ndarray, "T K 2"]:
    """Keypoints of the reflected picture; twins: each keypoint's left-right counterpart."""
    reflected = np.stack([2.0 * K[0, 2] - xy_px[..., 0], xy_px[..., 1]], axis=-1)
    return reflected[:, list(twins)]


def mirrored_boxes(
    box_px: Float[np.ndarray, "T 4"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "T 4"]:
    """Boxes x0 y0 x1 y1 of the reflected picture."""
    box = box_px.copy()
    box[:, [0, 2]] = 2.0 * K[0, 2] - box[:, [2, 0]]
    return box
