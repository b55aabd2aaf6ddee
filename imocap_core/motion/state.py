"""The solver's unknowns: rotations on their manifold, root paths, body shape, cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from imocap_core.rotations import exp, log

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
    """

    R_local: Float[Tensor, "B T 24 3 3"]
    trans: Float[Tensor, "B T 3"]
    betas: Float[Tensor, "B 10"]
    valid: Bool[Tensor, "B T"]
    camera_R: Float[Tensor, "B C 3 3"]
    camera_t: Float[Tensor, "B C 3"]
    log_focal: Float[Tensor, "B F"]
    other_betas: Float[Tensor, "B p 10"]

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
        return cls(R_local, trans, betas, valid, no_rotation, none, no_focal, no_other)

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
        of every other performer's shape."""
        return sum(self._global_sizes)

    @property
    def _global_sizes(self) -> list[int]:
        cameras, focal_lengths = 6 * self.camera_t.shape[1], self.log_focal.shape[1]
        return [
            self.betas.shape[1],
            cameras,
            focal_lengths,
            self.other_betas.shape[1] * self.betas.shape[1],
        ]

    def camera_columns(self, camera: int) -> slice:
        """Indices of a free camera's (rotation, translation) among the globals."""
        start = self.betas.shape[1] + 6 * camera
        return slice(start, start + 6)

    def focal_column(self, focal: int) -> int:
        """Index of a free focal length among the globals."""
        return self.betas.shape[1] + 6 * self.camera_t.shape[1] + focal

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
        d_betas, d_cameras, d_focal, d_other = d_globals.split(self._global_sizes, dim=1)
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
