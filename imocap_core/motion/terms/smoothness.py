"""Temporal smoothness: Eq. 7 on the rotation manifold, and accelerations.

Real accelerations are heavy-tailed: nearly none most of the time, and large in a strike or a step.
Their cost is logarithmic (the likelihood of Student's t), so rest is smooth and strikes stay sharp.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import POSE, MotionState
from imocap_core.motion.terms.in_time import padded, pairs, triples
from imocap_core.robust import cauchy
from imocap_core.rotations import log


@dataclass(frozen=True)
class PoseSmoothness:
    """Rotation velocities (Eq. 7, as geodesics) and accelerations (as chords).

    Attributes:
        velocity_weight: (24,) per joint, 1 / (rad per frame)^2.
        acceleration_weight: (24,) per joint, 1 / (rad per frame^2)^2, of small accelerations.
        acceleration_scale: square root of the cost above which it grows logarithmically.
    """

    velocity_weight: Float[Tensor, "24"]
    acceleration_weight: Float[Tensor, "24"]
    acceleration_scale: float

    def of(self, v: int, frames: int) -> PoseSmoothness:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        step = _steps(state).square().sum(-1) * self.velocity_weight
        return step.sum((1, 2)) + self._bend(_chords(state))[0].sum((1, 2))

    def _bend(self, chord: Tensor) -> tuple[Tensor, Tensor]:
        """(B, T-2, 24) cost of second differences and its derivative by their weighted square."""
        squared = chord.square().sum((-1, -2)) / 2 * self.acceleration_weight
        return cauchy(squared, self.acceleration_scale)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Velocity: its gradient by the increments is exactly (-r, +r), because a rotation keeps
        its own axis. Acceleration: the chord ``R0 - 2 R1 + R2`` is linear in each R, so
        ``d R = R hat(delta)`` gives exact 3x3 blocks."""
        self._add_velocity(normal, state)
        self._add_acceleration(normal, state)

    def _add_velocity(self, normal: NormalEquations, state: MotionState) -> None:
        step = (_steps(state) * self.velocity_weight[:, None]).flatten(2)
        pair = pairs(state.valid)
        weight = self.velocity_weight.repeat_interleave(3) * pair[..., None]
        normal.gradient[:, :-1, :POSE] -= step
        normal.gradient[:, 1:, :POSE] += step
        diagonal = torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)
        diagonal[:, :-1, :POSE] += weight
        diagonal[:, 1:, :POSE] += weight
        torch.diagonal(normal.next1, dim1=-2, dim2=-1)[:, :-1, :POSE] -= weight

    def _add_acceleration(self, normal: NormalEquations, state: MotionState) -> None:
        frames = state.valid.shape[1]
        if frames < 3:
            return
        chord = _chords(state)
        weight = self.acceleration_weight * triples(state.valid)[..., None] / 2
        weight = weight * self._bend(chord)[1]
        R = [state.R_local[:, k : frames - 2 + k] for k in range(3)]
        for a, coefficient in enumerate((1.0, -2.0, 1.0)):
            slope = coefficient * _vee_pull(R[a], chord) * weight[..., None]
            normal.gradient[:, a : frames - 2 + a, :POSE] += slope.flatten(2)
        # A frame is the first, the middle and the last of three chords, a pair of neighbours the
        # first and the last of two; a frame's block with itself is a multiple of the identity.
        of_frame = padded(weight, 0, 2) + 4 * padded(weight, 1, 1) + padded(weight, 2, 0)
        diagonal = torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)
        diagonal[..., :POSE] += 2 * of_frame.repeat_interleave(3, -1)
        of_pair = -2 * (padded(weight, 0, 1) + padded(weight, 1, 0))
        for target, turn, share in (
            (normal.next1, _relative_rotations(state), of_pair),
            (normal.next2, R[0].mT @ R[2], weight),
        ):
            _add_joint_blocks(target, _chord_block(turn) * share[..., None, None])


@dataclass(frozen=True)
class PathSmoothness:
    """Velocity and acceleration of the root path.

    Attributes:
        velocity_weight: 1 / (m per frame)^2; acceleration_weight: 1 / (m per frame^2)^2.
    """

    velocity_weight: float
    acceleration_weight: float

    def _stencils(self, state: MotionState) -> list[tuple[float, tuple[float, ...], Tensor]]:
        bends = triples(state.valid) if state.valid.shape[1] > 2 else state.valid[:, :0]
        return [
            (self.velocity_weight, (-1.0, 1.0), pairs(state.valid)),
            (self.acceleration_weight, (1.0, -2.0, 1.0), bends),
        ]

    def of(self, v: int, frames: int) -> PathSmoothness:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        total = torch.zeros_like(state.betas[:, 0])
        for weight, stencil, mask in self._stencils(state):
            if mask.shape[1]:
                difference = _difference(state.trans, stencil) * mask[..., None]
                total = total + weight * difference.square().sum((1, 2))
        return total

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Linear in the unknowns: constant blocks."""
        blocks = (normal.diagonal, normal.next1, normal.next2)
        for weight, stencil, mask in self._stencils(state):
            length = mask.shape[1]
            if not length:
                continue
            difference = _difference(state.trans, stencil) * mask[..., None] * weight
            for a, ca in enumerate(stencil):
                normal.gradient[:, a : a + length, POSE:] += ca * difference
                for b in range(a, len(stencil)):
                    target = torch.diagonal(blocks[b - a], dim1=-2, dim2=-1)
                    target[:, a : a + length, POSE:] += weight * ca * stencil[b] * mask[..., None]


def _relative_rotations(state: MotionState) -> Tensor:
    """(B, T-1, 24, 3, 3) relative rotation from each frame to the next."""
    R = state.R_local
    return state.cached((_relative_rotations,), lambda: R[:, :-1].mT @ R[:, 1:])


def _steps(state: MotionState) -> Tensor:
    """(B, T-1, 24, 3) the same as vectors, 0 at padding."""
    pair = pairs(state.valid)[..., None, None]
    return state.cached((_steps,), lambda: log(_relative_rotations(state)) * pair)


def _chords(state: MotionState) -> Tensor:
    """(B, T-2, 24, 3, 3) second difference of the rotation matrices."""
    R = state.R_local
    if R.shape[1] < 3:
        return R[:, :0]
    return _difference(R, (1.0, -2.0, 1.0)) * triples(state.valid)[..., None, None, None]


def _difference(x: Tensor, stencil: tuple[float, ...]) -> Tensor:
    length = x.shape[1] - len(stencil) + 1
    return sum((c * x[:, k : k + length] for k, c in enumerate(stencil)), torch.zeros(()).to(x))


def _vee_pull(R: Tensor, chord: Tensor) -> Tensor:
    """Gradient of ``<chord, R hat(delta)>`` by delta: (..., 3)."""
    M = R.transpose(-1, -2) @ chord
    antisymmetric = M - M.transpose(-1, -2)
    return torch.stack(
        [antisymmetric[..., 2, 1], antisymmetric[..., 0, 2], antisymmetric[..., 1, 0]], -1
    )


def _chord_block(Q: Tensor) -> Tensor:
    """``<Ra hat(e_i), Rb hat(e_j)>`` for all i, j: ``tr(Q) I - Q^T`` with ``Q = Ra^T Rb``."""
    trace = Q.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None, None]
    return trace * torch.eye(3, dtype=Q.dtype, device=Q.device) - Q.transpose(-1, -2)


def _add_joint_blocks(target: Tensor, blocks: Tensor) -> None:
    """Add (B, L, 24, 3, 3) blocks on the joint diagonal of the first L frames."""
    length = blocks.shape[1]
    for i in range(3):
        for j in range(3):
            part = target[:, :length, i:POSE:3, j:POSE:3]
            torch.diagonal(part, dim1=-2, dim2=-1).add_(blocks[..., i, j])
