"""Priors: pose, shape, limits of hinges, focal lengths, scores in modes of variation.

The shape prior: beta ~ N(0, 1). Every fitter needs one; the paper does not print it. Images tell
proportions, not size: a small person near the camera looks like a tall one far away. Nor do they
tell a torso's form: bodies with the same limbs, hips, shoulders and height of the trunk differ in
where the spine runs. Errors of keypoints and poses would leak into both, so size and the directions
of shape that no keypoint tells have weights of their own (docs/decisions.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from imocap_core.body import Model
from imocap_core.conventions import LIMB_BONES, SIDES, SMPL_JOINTS
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.state import POSE, MotionState
from imocap_core.motion.terms.base import OneForAll
from imocap_core.robust import geman_mcclure
from imocap_core.rotations import for_processor, hat, inverse_right_jacobian
from imocap_core.workers import compiled


@dataclass(frozen=True)
class PosePriorTerm(OneForAll):
    """Twice the negative log likelihood of each frame under its best component (max-mixture).

    Max-mixture (Olson & Agarwal, 2013; used for bodies by SMPLify) keeps the term a sum of
    squares: the best component's Mahalanobis distance plus its constant.
    """

    prior: PosePrior
    weight: float

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion, summed over valid frames."""
        distance, _ = self._best(state)
        return self.weight * torch.where(state.valid, distance, 0.0).sum(1)

    def _best(self, state: MotionState) -> tuple[Tensor, Tensor]:
        return state.cached((self.prior,), lambda: self.prior.best(_articulation(state)))

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Precision of the best component, pulled back by d theta / d delta = Jr^-1."""
        _, component = self._best(state)
        pull = inverse_right_jacobian(state.axis_angle[:, :, 1:])
        pull = pull * state.valid[..., None, None, None]
        offset = _articulation(state) - self.prior.mean[component]
        if for_processor(pull):
            target = normal.diagonal[..., 3:POSE, 3:POSE], normal.gradient[..., 3:POSE]
            precision = self.weight * self.prior.precision
            arrays = (*target, pull.mT.contiguous(), offset, component)
            for motion in zip(*(x.numpy() for x in arrays), strict=True):
                _add_pulled_back(*motion, precision.numpy())
            return
        precision = self.weight * self.prior.precision[component]
        slope = (precision @ offset[..., None]).unflatten(2, (-1, 3))
        normal.diagonal[..., 3:POSE, 3:POSE] += _by_joint(pull, _by_joint(pull, precision).mT)
        normal.gradient[..., 3:POSE] += (pull.mT @ slope).flatten(2)


@compiled
def _add_pulled_back(diagonal, gradient, pull, offset, component, precision):  # type: ignore[no-untyped-def]
    """Add ``J P J^T`` and ``J P r`` of one motion, with the frames' blocks J (T, J, 3, 3): a block
    mixes three neighbouring rows, and what is symmetric may change its rows for columns."""
    half, turned = np.empty_like(precision[0]), np.empty_like(precision[0])
    for t in range(len(offset)):
        _mix_rows(pull[t], precision[component[t]], half)
        gradient[t] += half @ offset[t]
        turned[:] = half.T
        _mix_rows(pull[t], turned, half)
        diagonal[t] += half


@compiled
def _mix_rows(blocks, rows, mixed):  # type: ignore[no-untyped-def]
    for j in range(len(blocks)):
        a, b, c = rows[3 * j], rows[3 * j + 1], rows[3 * j + 2]
        for i in range(3):
            x, y, z, out = blocks[j, i, 0], blocks[j, i, 1], blocks[j, i, 2], mixed[3 * j + i]
            for k in range(len(out)):
                out[k] = x * a[k] + y * b[k] + z * c[k]


def _by_joint(pull: Tensor, columns: Tensor) -> Tensor:
    """``pull^T`` (B, T, J, 3, 3), block by block, times columns (B, T, 3J, n)."""
    return (pull.mT @ columns.unflatten(2, (-1, 3))).flatten(2, 3)


def _articulation(state: MotionState) -> Tensor:
    """(B, T, 69) axis-angle of every joint but the root."""
    return state.axis_angle[:, :, 1:].flatten(2)


LENGTH_COUNTS = (2.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0)  # of each of `length_rates` in a body


@dataclass(frozen=True)
class ShapePrior(OneForAll):
    """``beta^T precision beta``: beta is in standard deviations of the population."""

    precision: Float[Tensor, "n n"]

    @classmethod
    def of_body(
        cls, model: Model, weight: float, hidden_weight: float, size_weight: float
    ) -> ShapePrior:
        """``weight`` along the proportions that keypoints tell, ``size_weight`` along size,
        ``hidden_weight`` along the form of the torso."""
        hidden, size = hidden_directions(model), size_direction(model)
        of_form, of_size = hidden @ hidden.T, torch.outer(size, size)
        of_proportions = torch.eye(model.num_betas).to(hidden) - of_form - of_size
        return cls(weight * of_proportions + hidden_weight * of_form + size_weight * of_size)

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        betas = torch.cat([state.betas[:, None], state.other_betas], 1)
        return torch.einsum("bpi,ij,bpj->b", betas, self._precision(state), betas)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """A constant block for every performer."""
        precision = self._precision(state)
        for performer in range(1 + state.other_betas.shape[1]):
            columns = state.shape_columns(performer)
            normal.corner[:, columns, columns] += precision
            normal.corner_gradient[:, columns] += state.of_performer(performer).betas @ precision

    def _precision(self, state: MotionState) -> Float[Tensor, "n n"]:
        return self.precision.to(state.betas)


def hidden_directions(model: Model) -> Float[Tensor, "n k"]:
    """Orthonormal directions of shape that leave the lengths between the twelve joints, and so
    their size, as they are."""
    _, singular, rows = torch.linalg.svd(length_rates(model))
    rank = int((singular > 1e-6 * singular[0]).sum())
    return rows[rank:].T


def size_direction(model: Model) -> Float[Tensor, " n"]:
    """Unit vector of shape coefficients along which the lengths between the twelve joints grow
    most, all together.

    Those alone: feet, hands and neck, which no keypoint tells, would shrink to make up for limbs.
    """
    rates = length_rates(model)
    longer = rates.T @ rates.new_tensor(LENGTH_COUNTS)
    return longer / torch.linalg.vector_norm(longer)


def length_rates(model: Model) -> Float[Tensor, "7 n"]:
    """Metres per unit of each coefficient of what the twelve joints tell of a shape: limbs, both
    sides alike, the widths of hips and shoulders, the trunk between them."""
    points = {
        name: (model.joints_template[k], model.joints_shapedirs[k, :, : model.num_betas])
        for k, name in enumerate(SMPL_JOINTS)
    }
    for part in ("hip", "shoulder"):
        left, right = (points[f"{side}_{part}"] for side in SIDES)
        points[part] = ((left[0] + right[0]) / 2, (left[1] + right[1]) / 2)

    def rate(start: str, end: str) -> Float[Tensor, " n"]:
        bone = points[end][0] - points[start][0]
        growth = points[end][1] - points[start][1]
        return (bone / torch.linalg.vector_norm(bone)) @ growth

    limbs = [
        torch.stack([rate(f"{s}_{a}", f"{s}_{b}") for s in SIDES]).mean(0) for a, b in LIMB_BONES
    ]
    widths = [rate(f"right_{part}", f"left_{part}") for part in ("hip", "shoulder")]
    return torch.stack([*limbs, *widths, rate("hip", "shoulder")])


# joint, axis-angle component, sign in which it flexes (SMPL's T-pose: y up, facing +z)
HINGES = (
    ("left_knee", 0, 1.0),
    ("right_knee", 0, 1.0),
    ("left_elbow", 1, -1.0),
    ("right_elbow", 1, 1.0),
)


@dataclass(frozen=True)
class HingeLimits(OneForAll):
    """``weight * max(0, -flexion - slack)^2`` for both knees and elbows, radians."""

    weight: float
    slack_rad: float = 0.1

    def _violation(self, state: MotionState) -> list[tuple[int, int, float, Tensor]]:
        hinges = [(SMPL_JOINTS.index(name), axis, sign) for name, axis, sign in HINGES]
        flexions = [sign * state.axis_angle[:, :, j, axis] for j, axis, sign in hinges]
        excesses = [(-x - self.slack_rad).clamp_min(0.0) * state.valid for x in flexions]
        return [(*hinge, x) for hinge, x in zip(hinges, excesses, strict=True)]

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        parts = [excess.square().sum(1) for *_, excess in self._violation(state)]
        return self.weight * torch.stack(parts).sum(0)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Active only where violated."""
        for joint, axis, sign, excess in self._violation(state):
            if not (excess > 0).any():
                continue
            theta = state.axis_angle[:, :, joint]
            row = -sign * inverse_right_jacobian(theta)[..., axis, :]
            row = row * (excess > 0)[..., None]
            span = slice(3 * joint, 3 * joint + 3)
            outer = row[..., :, None] * row[..., None, :]
            normal.diagonal[..., span, span] += self.weight * outer
            normal.gradient[..., span] += self.weight * row * excess[..., None]


@dataclass(frozen=True)
class FocalPrior(OneForAll):
    """``weight * (log f - log f_assumed)^2`` of every free focal length.

    Attributes:
        assumed: (F,) logarithm of the assumed focal length over that of the view; weight: (F,).
    """

    assumed: Float[Tensor, " F"]
    weight: Float[Tensor, " F"]

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return (self.weight * (state.log_focal - self.assumed).square()).sum(-1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """A constant diagonal."""
        first = state.focal_column(0)
        columns = slice(first, first + len(self.weight))
        torch.diagonal(normal.corner, dim1=-2, dim2=-1)[:, columns] += self.weight
        normal.corner_gradient[:, columns] += self.weight * (state.log_focal - self.assumed)


_UP_SIGMAS, _UP_ROUNDS = 12.0, 5  # Geman-McClure scale: a video's up may be upside down


@dataclass(frozen=True)
class LevelCameras(OneForAll):
    """Prior of level cameras: each sees the world's up near the one that its video alone gives.

    ``count * sum_c rho(max(0, |R_c up - alone_c| / sd_c - 1)^2)``: within its standard deviation a
    video's up is less certain than what all videos show.

    Attributes:
        up: (3,) of the world; alone: (C, 3) in the axes of the cameras.
        per_sd: (C,) 1 / rad; count: observations that one is worth.
    """

    up: Float[Tensor, "3"]
    alone: Float[Tensor, "C 3"]
    per_sd: Float[Tensor, " C"]
    count: float

    @staticmethod
    def common(ups: Float[Tensor, "M 3"], per_sd: Float[Tensor, " M"]) -> Float[Tensor, "3"]:
        """The robust mean of ups in the world; per_sd: 0 where one is unknown."""
        up = robust = torch.ones_like(per_sd)
        for _ in range(_UP_ROUNDS):
            up = normalize((robust * per_sd**2) @ ups, dim=0)
            squares = per_sd**2 * (ups - up).square().sum(-1)
            robust = geman_mcclure(squares, _UP_SIGMAS)[1]
        return up

    def _off(self, state: MotionState) -> tuple[Tensor, Tensor, Tensor]:
        """Up in the cameras' axes (B, C, 3), how far off, and in deviations beyond one (B, C)."""
        turned = state.camera_R @ self.up
        off = turned - self.alone
        return turned, off, (self.per_sd * off.norm(dim=-1) - 1).clamp_min(0.0)

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return self.count * geman_mcclure(self._off(state)[2].square(), _UP_SIGMAS)[0].sum(-1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Blocks of the cameras' rotations."""
        turned, off, excess = self._off(state)
        robust = geman_mcclure(excess.square(), _UP_SIGMAS)[1]
        weight = self.count * self.per_sd**2 * robust * excess / (excess + 1)
        J = -hat(turned)
        for c in range(len(self.alone)):
            rows = slice(first := state.camera_columns(c).start, first + 3)
            normal.corner[:, rows, rows] += weight[:, c, None, None] * (J[:, c].mT @ J[:, c])
            pull = (J[:, c].mT @ off[:, c, :, None])[..., 0]
            normal.corner_gradient[:, rows] += weight[:, c, None] * pull


class ScorePrior(OneForAll):
    """Scores of performances are normal, their variance 1."""

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return state.scores.square().sum((1, 2))

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """A constant diagonal."""
        columns = slice(state.score_columns(0).start, state.unknown_globals)
        torch.diagonal(normal.corner, dim1=-2, dim2=-1)[:, columns] += 1.0
        normal.corner_gradient[:, columns] += state.scores.flatten(1)
