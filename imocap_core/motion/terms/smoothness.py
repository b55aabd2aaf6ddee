"""Temporal smoothness: Eq. 7 on the rotation manifold, and accelerations of joints in space.

Real accelerations are heavy-tailed and come in spells: nearly none most of the time, and large in a
strike or a step. Rotations' have a logarithmic cost (the likelihood of Student's t), so rest is
smooth and strikes stay sharp. Rotations that are smooth by themselves still add up: the noise of a
hip, a trunk and an arm meets at the wrist. So the accelerations of joints are a term of their own,
its cost the logarithm of the energy of a short window. A smaller person nearer to the camera looks
the same and accelerates less: accelerations are divided by the body's size, or calm would shrink
it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.state import POSE, Body, MotionState
from imocap_core.motion.terms.base import OneForAll, isotropic, padded, pairs, triples
from imocap_core.robust import cauchy
from imocap_core.rotations import for_processor, log
from imocap_core.workers import compiled


@dataclass(frozen=True)
class PoseSmoothness(OneForAll):
    """Rotation velocities (Eq. 7, as geodesics) and accelerations (as chords).

    Attributes:
        velocity_weight: (24,) per joint, 1 / (rad per frame)^2.
        acceleration_weight: (24,) per joint, 1 / (rad per frame^2)^2, of small accelerations.
        acceleration_scale: square root of the cost above which it grows logarithmically.
    """

    velocity_weight: Float[Tensor, "24"]
    acceleration_weight: Float[Tensor, "24"]
    acceleration_scale: float

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        step = _steps(state).square().sum(-1) * self.velocity_weight
        return step.sum((1, 2)) + self._bend(_chords(state))[0].sum((1, 2))

    def _bend(self, chord: Tensor) -> tuple[Tensor, Tensor]:
        """(B, T-2, 24) cost of chords and its derivative by their weighted square."""
        squared = chord.square().sum((-1, -2)) / 2 * self.acceleration_weight
        return cauchy(squared, self.acceleration_scale)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Velocity: its gradient by the increments is exactly (-r, +r), because a rotation keeps
        its own axis. Acceleration: the chord ``R0 - 2 R1 + R2`` is linear in each R, so
        ``d R = R hat(delta)`` gives exact 3x3 blocks."""
        if for_processor(state.R_local):
            blocks = normal.diagonal, normal.next1, normal.next2, normal.gradient
            weights = self.velocity_weight.numpy(), self.acceleration_weight.numpy()
            arrays = (*blocks, state.R_local.contiguous(), _steps(state), state.valid)
            for motion in zip(*(x.numpy() for x in arrays), strict=True):
                _add_rotations(motion, *weights, self.acceleration_scale**2)
            return
        step = (_steps(state) * self.velocity_weight[:, None]).flatten(2)
        pair = pairs(state.valid)
        weight = self.velocity_weight.repeat_interleave(3) * pair[..., None]
        normal.gradient[:, :-1, :POSE] -= step
        normal.gradient[:, 1:, :POSE] += step
        diagonal = torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)
        diagonal[:, :-1, :POSE] += weight
        diagonal[:, 1:, :POSE] += weight
        torch.diagonal(normal.next1, dim1=-2, dim2=-1)[:, :-1, :POSE] -= weight
        self._add_acceleration(normal, state)

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


@compiled
def _add_rotations(arrays, speed, bend, limit):  # type: ignore[no-untyped-def]
    """`PoseSmoothness.add_to` of one motion; limit: squared scale of accelerations."""
    diagonal, next1, next2, gradient, R, steps, valid = arrays
    chord = np.empty((3, 3))
    for t in range(len(R) - 1):
        if not (valid[t] and valid[t + 1]):
            continue
        for k in range(3 * len(speed)):
            pull = steps[t, k // 3, k % 3] * speed[k // 3]
            gradient[t, k] -= pull
            gradient[t + 1, k] += pull
            diagonal[t, k, k] += speed[k // 3]
            diagonal[t + 1, k, k] += speed[k // 3]
            next1[t, k, k] -= speed[k // 3]
        if t + 2 == len(R) or not valid[t + 2]:
            continue
        for j in range(len(bend)):
            a, b, c = R[t, j], R[t + 1, j], R[t + 2, j]
            squared = 0.0
            for i in range(9):
                chord[i // 3, i % 3] = a[i // 3, i % 3] - 2 * b[i // 3, i % 3] + c[i // 3, i % 3]
                squared += chord[i // 3, i % 3] ** 2
            weight = bend[j] / 2 * limit / (limit + squared / 2 * bend[j])
            _add_end(diagonal[t], gradient[t], a, chord, weight, 1.0, 3 * j)
            _add_end(diagonal[t + 1], gradient[t + 1], b, chord, weight, -2.0, 3 * j)
            _add_end(diagonal[t + 2], gradient[t + 2], c, chord, weight, 1.0, 3 * j)
            _add_relative(next1[t], a, b, -2 * weight, 3 * j)
            _add_relative(next1[t + 1], b, c, -2 * weight, 3 * j)
            _add_relative(next2[t], a, c, weight, 3 * j)


@compiled
def _add_end(diagonal, gradient, R, chord, weight, coefficient, first):  # type: ignore[no-untyped-def]
    """What a chord adds to the rotation R in it: the slope by ``<chord, R hat(delta)>``."""
    for i in range(3):
        p, q, pull = (i + 1) % 3, (i + 2) % 3, 0.0
        for k in range(3):
            pull += R[k, q] * chord[k, p] - R[k, p] * chord[k, q]
        gradient[first + i] += coefficient * weight * pull
        diagonal[first + i, first + i] += 2 * coefficient**2 * weight


@compiled
def _add_relative(target, a, b, weight, first):  # type: ignore[no-untyped-def]
    """Add `_chord_block` of ``a^T b``, weighted."""
    for i in range(3):
        for k in range(3):
            product = weight * (a[0, i] * b[0, k] + a[1, i] * b[1, k] + a[2, i] * b[2, k])
            target[first + k, first + i] -= product
            if i == k:
                for n in range(3):
                    target[first + n, first + n] += product


@dataclass(frozen=True)
class PathSmoothness(OneForAll):
    """Velocity and acceleration of the root path.

    Attributes:
        velocity_weight: 1 / (m per frame)^2; acceleration_weight: 1 / (m per frame^2)^2.
    """

    velocity_weight: float
    acceleration_weight: float

    def _stencils(self, state: MotionState) -> list[tuple[float, tuple[float, ...], Tensor]]:
        return [
            (self.velocity_weight, (-1.0, 1.0), pairs(state.valid)),
            (self.acceleration_weight, _STENCIL, triples(state.valid)),
        ]

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        total = torch.zeros_like(state.betas[:, 0])
        for weight, stencil, mask in self._stencils(state):
            difference = _difference(state.trans, stencil) * mask[..., None]
            total = total + weight * difference.square().sum((1, 2))
        return total

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Linear in the unknowns: constant blocks."""
        blocks = (normal.diagonal, normal.next1, normal.next2)
        for weight, stencil, mask in self._stencils(state):
            length = mask.shape[1]
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
    return _difference(state.R_local, _STENCIL) * triples(state.valid)[..., None, None, None]


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
    part = target[:, : blocks.shape[1], :POSE, :POSE].unflatten(-1, (-1, 3)).unflatten(-3, (-1, 3))
    torch.diagonal(part, dim1=2, dim2=4).add_(blocks.movedim(2, -1))


# Fitted to the training clips at 30 frames/s (tools/measure_accelerations.py).
FREEDOM = 1.4  # degrees of freedom of Student's t
SCALE_M_S2 = {
    "hip": 1.2,
    "knee": 2.5,
    "ankle": 3.8,
    "shoulder": 2.1,
    "elbow": 2.1,
    "wrist": 2.7,
    "head": 2.4,
}
TAIL = (FREEDOM + 3.0) ** 0.5  # scale of the Cauchy loss that is this likelihood in 3 dimensions
WINDOW_S = 0.15
_STENCIL = (1.0, -2.0, 1.0)


@dataclass(frozen=True)
class JointAcceleration(OneForAll):
    """Student's t likelihood of the mean squared acceleration in a window about each frame.

    Attributes:
        body: whose joints; those of `SCALE_M_S2` have a cost.
        fps: frames per second; weight: of the whole term.
    """

    body: Body
    fps: float
    weight: float

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        xyz = self.body.positions(self.body.moving, state)
        bend = _bends(xyz, state.valid) / self._size(state)[0][:, None, None, None]
        return self._energy_cost(bend)[0].sum((1, 2))

    def _size(self, state: MotionState) -> tuple[Float[Tensor, " B"], Float[Tensor, " n"]]:
        """Height of the head above the ankles at rest, 1 for the mean body, and its gradient."""
        ends = [SMPL_JOINTS.index(name) for name in ("head", "left_ankle", "right_ankle")]
        share = state.trans.new_tensor([1.0, -0.5, -0.5])
        model, count = self.body.model, state.betas.shape[1]
        mean = share @ model.joints_template.to(share)[ends, 1]
        slope = share @ model.joints_shapedirs.to(share)[ends, 1, :count] / mean
        return 1.0 + state.betas @ slope, slope

    def _precision(self, template: Tensor) -> Float[Tensor, " J"]:
        """1 / (m per frame^2)^2 of small accelerations."""
        kinds = [name.rpartition("_")[2] for name in self.body.moving.names]
        scale = template.new_tensor([SCALE_M_S2[kind] for kind in kinds]) / self.fps**2
        return TAIL**2 / (FREEDOM * scale**2)

    def _energy_cost(self, bend: Tensor) -> tuple[Tensor, Tensor]:
        """(B, T-2, J) costs, and the weights of squared accelerations."""
        half = round(WINDOW_S * self.fps / 2)
        precision = self._precision(bend)
        energy = _window_mean(precision * bend.square().sum(-1), half)
        cost, slope = cauchy(energy, TAIL)
        # A symmetric window with zeros beyond both ends is its own adjoint.
        return self.weight * cost, self.weight * precision * _window_mean(slope, half)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """An acceleration is linear in three frames' joints: with derivatives J and weights W,
        frames i apart get ``J^T W J'`` of the stencils that hold both."""
        if state.valid.shape[1] < len(_STENCIL):
            return
        points, (size, slope) = self.body.derivatives(self.body.moving, state), self._size(state)
        size = size[:, None, None, None]
        bend = _bends(points.xyz, state.valid) / size
        weight = self._energy_cost(bend)[1] * triples(state.valid)[..., None]  # (B, T-2, J)
        for apart, target in enumerate((normal.diagonal, normal.next1, normal.next2)):
            of_pairs = _pair_weights(weight / size[..., 0] ** 2, apart)
            first, later = points.of_frames(slice(of_pairs.shape[1])), slice(apart, None)
            metric = isotropic(of_pairs)
            first.add_products(target[:, : metric.shape[1]], points.of_frames(later), metric)
        shape = _second_difference(points.d_beta) - bend[..., None] * slope
        rows = torch.cat([shape / size[..., None], bend[..., None]], -1)
        pull = weight[..., None, None] * rows
        ends = padded(pull, 0, 2) - 2 * padded(pull, 1, 1) + padded(pull, 2, 0)
        normal.add_columns(points.pulled(ends) / size, rows.flatten(1, 3), pull.flatten(1, 3))


def _bends(xyz: Tensor, valid: Tensor) -> Tensor:
    """(B, T-2, J, 3) second differences, 0 where a frame is padding."""
    return _second_difference(xyz) * triples(valid)[..., None, None]


def _second_difference(x: Tensor) -> Tensor:
    return x[:, :-2] - 2 * x[:, 1:-1] + x[:, 2:]


def _window_mean(x: Tensor, half: int) -> Tensor:
    """Means over 2 half + 1 steps of (B, N, J), zeros beyond both ends."""
    if not x.shape[1]:
        return x
    return padded(x, half, half).unfold(1, 2 * half + 1, 1).mean(-1)


def _pair_weights(weight: Tensor, apart: int) -> Tensor:
    """(B, T - apart, 3J) weight of each pair of frames: the sum over the stencils with both."""
    total = torch.zeros(()).to(weight)
    for k in range(len(_STENCIL) - apart):
        product = _STENCIL[k] * _STENCIL[k + apart]
        total = total + product * padded(weight, k, len(_STENCIL) - 1 - apart - k)
    return total
