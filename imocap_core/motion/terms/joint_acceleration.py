"""Accelerations of joints in space, calm or vigorous for a while (Student's t over a window).

Rotations that are smooth by themselves still add up: the noise of a hip, a trunk and an arm meets
at the wrist. So the accelerations of joints are a term of their own. Those of real motion are
heavy-tailed and come in spells: their cost is the logarithm of the energy of a short window, which
calms a person at rest and lets a strike be.

A smaller person nearer to the camera looks the same and accelerates less. So that calm does not
shrink the body, accelerations are divided by its size.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.kinematics import Body, Points
from imocap_core.motion.solver.normal import NormalEquations, add_product
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms.in_time import padded, pieces, triples
from imocap_core.robust import cauchy

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
STENCIL = (1.0, -2.0, 1.0)


@dataclass(frozen=True)
class JointAcceleration:
    """Student's t likelihood of the mean squared acceleration in a window about each frame.

    Attributes:
        body: whose joints; those of `SCALE_M_S2` have a cost.
        fps: frames per second; weight: of the whole term.
    """

    body: Body
    fps: float
    weight: float

    def of(self, v: int, frames: int) -> JointAcceleration:
        """The same for every motion."""
        return self

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        xyz = self.body.positions(self.body.moving, state).xyz
        bend = _bends(xyz, state.valid) / self._size(state)[0][:, None, None, None]
        return self._energy_cost(bend)[0].sum((1, 2))

    def _size(self, state: MotionState) -> tuple[Float[Tensor, " B"], Float[Tensor, " n"]]:
        """Height of the head above the ankles at rest, 1 for the mean body, and its gradient."""
        rows = self.body.joints.names
        ends = [rows.index(name) for name in ("head", "left_ankle", "right_ankle")]
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
        parts = list(pieces(state.valid.shape[1]))
        if state.valid.shape[1] < len(STENCIL):
            return
        size, moving = self._size(state)[0], self.body.moving
        whole = self.body.derivatives(moving, state) if len(parts) == 1 else None
        xyz = (whole or self.body.positions(moving, state)).xyz
        bend = _bends(xyz, state.valid) / size[:, None, None, None]
        inside = triples(state.valid)[..., None]
        weight = (self._energy_cost(bend)[1] * inside).repeat_interleave(3, -1)  # (B, T-2, 3J)
        of_pairs = [_pair_weights(weight / size[:, None, None] ** 2, k) for k in range(3)]
        for frames in parts:
            around = slice(max(frames.start - 2, 0), min(frames.stop + 2, parts[-1].stop))
            points = whole or self.body.derivatives(moving, state, around)
            near = slice(around.start, around.stop - 2)
            inputs = (bend[:, near].flatten(2), weight[:, near], of_pairs)
            self._add_piece(normal, self._size(state), frames, around, points, *inputs)

    def _add_piece(
        self,
        normal: NormalEquations,
        sizes: tuple[Tensor, Tensor],
        frames: slice,
        around: slice,
        points: Points,
        bend: Float[Tensor, "B bends n"],
        weight: Float[Tensor, "B bends n"],
        of_pairs: list[Tensor],
    ) -> None:
        """Rows of some frames, from the derivatives of these and of two frames on either side."""
        total, (size, slope) = normal.diagonal.shape[1], sizes
        assert points.d_pose is not None
        assert points.d_beta is not None
        moves = torch.eye(3).to(points.xyz).expand(*points.xyz.shape, 3)
        J = torch.cat([points.d_pose, moves], -1).flatten(2, 3)  # (B, T, 3J, 75)
        shape = _second_difference(points.d_beta.flatten(2, 3))
        shape = (shape - bend[..., None] * slope) / size[:, None, None, None]
        mine = slice(frames.start - around.start, frames.stop - around.start)
        J_sized = J[:, mine] / size[:, None, None, None]
        _add_globals(normal.of_frames(frames), J_sized, shape, bend, weight, mine)
        for apart, target in enumerate((normal.diagonal, normal.next1, normal.next2)):
            rows = slice(frames.start, min(frames.stop, total - apart))
            first = slice(mine.start, mine.start + rows.stop - rows.start)
            later = J[:, first.start + apart : first.stop + apart]
            add_product(target[:, rows], J[:, first], of_pairs[apart][:, rows, :, None] * later)


def _add_globals(
    normal: NormalEquations, J: Tensor, shape: Tensor, bend: Tensor, weight: Tensor, mine: slice
) -> None:
    """Gradients, and what couples frames with the shape.

    Args:
        J: of the frames of ``normal``, which among those around them are ``mine``.
        shape: (B, N-2, 3J, n) derivatives of the N frames around them; bend, weight: (B, N-2, 3J).
    """
    count = shape.shape[-1]
    pull = weight[..., None] * torch.cat([shape, bend[..., None]], -1)
    ends = [padded(pull, k, 2 - k)[:, mine] for k in range(len(STENCIL))]
    columns = J.mT @ (ends[0] - 2 * ends[1] + ends[2])
    normal.border[..., :count] += columns[..., :count]
    normal.gradient += columns[..., count]
    corner = shape[:, mine].flatten(1, 2).mT @ pull[:, mine].flatten(1, 2)
    normal.corner[:, :count, :count] += corner[..., :count]
    normal.corner_gradient[:, :count] += corner[..., count]


def _bends(xyz: Tensor, valid: Tensor) -> Tensor:
    """(B, T-2, J, 3) second differences, 0 where a frame is padding."""
    if xyz.shape[1] < len(STENCIL):
        return xyz[:, :0]
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
    for k in range(len(STENCIL) - apart):
        product = STENCIL[k] * STENCIL[k + apart]
        total = total + product * padded(weight, k, len(STENCIL) - 1 - apart - k)
    return total
