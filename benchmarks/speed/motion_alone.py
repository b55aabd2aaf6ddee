"""A motion with known cameras and shape as residuals, for solvers that need them one by one.

The terms of the objective give costs and normal equations. Here the same costs are squared norms
of residuals: ``u = r sqrt(rho(s) / s)`` of a robust loss rho with ``s = r^2``, so that
``|u|^2 = rho``, and the pose prior's whitened distance. Left out of the whole problem are cameras,
shape, and the terms without a simple root (accelerations of joints, limits).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from benchmarks.solver.race import first_common_problem, newton
from benchmarks.solver.scene import MadeScene
from imocap_core.motion.state import FRAME_UNKNOWNS, POSE, MotionState
from imocap_core.motion.terms import PathSmoothness, PosePriorTerm, PoseSmoothness, Reprojection
from imocap_core.motion.terms.base import Term
from imocap_core.motion.terms.view import project, projection_jacobian
from imocap_core.params import MotionParams
from imocap_core.rotations import inverse_right_jacobian, log, right_jacobian

JOINTS = POSE // 3
Rows = tuple[Float[Tensor, "N m"], Float[Tensor, "N m n"]]
"""Residuals of N frames, pairs or triples of frames, and derivatives by all their unknowns."""


@dataclass(frozen=True)
class MotionAlone:
    """Unknown are the joints' rotations and the root's path; all else is known.

    image: at least one; the others one each.
    """

    start: MotionState
    image: tuple[Reprojection, ...]
    prior: PosePriorTerm
    pose: PoseSmoothness
    path: PathSmoothness

    @property
    def terms(self) -> list[Term]:
        """As Gauss-Newton takes them."""
        return [*self.image, self.prior, self.pose, self.path]

    @property
    def frames(self) -> int:
        """T."""
        return self.start.valid.shape[1]

    def state(self, x: Float[np.ndarray, " n"]) -> MotionState:
        """The start after increments of all frames, one frame after another."""
        steps = torch.as_tensor(x).reshape(1, self.frames, FRAME_UNKNOWNS)
        return self.start.retract(steps, steps.new_zeros(1, self.start.unknown_globals))

    def part(self, first: int, frames: int) -> MotionAlone:
        """Some consecutive frames by themselves."""
        span, start = slice(first, first + frames), self.start
        R_local, trans, valid = (x[:, span] for x in (start.R_local, start.trans, start.valid))
        image = tuple(
            replace(term, views=tuple(view.of_frames(span) for view in term.views))
            for term in self.image
        )
        return replace(self, start=MotionState.of(R_local, trans, start.betas, valid), image=image)

    def rows(self, x: Float[np.ndarray, " n"], kinds: Sequence[int] = (0, 1, 2)) -> list[Rows]:
        """Residuals of the frames (kind 0), of pairs and of triples of neighbours."""
        state = self.state(x)
        steps = torch.as_tensor(x).reshape(self.frames, FRAME_UNKNOWNS)
        chart = torch.eye(FRAME_UNKNOWNS, dtype=steps.dtype).repeat(self.frames, 1, 1)
        _set_joints(chart, right_jacobian(steps[:, :POSE].unflatten(1, (JOINTS, 3))))
        of_kind = (self._frame_rows, self._pair_rows, self._bend_rows)
        return [(r, _by_chart(J, chart)) for r, J in (of_kind[k](state) for k in kinds)]

    def _frame_rows(self, state: MotionState) -> Rows:
        """Reprojection and prior."""
        alone = [*(_image_rows(term, state) for term in self.image), _prior_rows(self.prior, state)]
        residual, J = (torch.cat(part, 1) for part in zip(*alone, strict=True))
        return residual, J

    def _pair_rows(self, state: MotionState) -> Rows:
        """Velocities: of rotations as vectors, of the path as differences."""
        R, path = state.R_local[0], state.trans[0]
        step = log(R[:-1].mT @ R[1:])  # (T-1, 24, 3)
        turn = inverse_right_jacobian(step)
        J = step.new_zeros(len(step), FRAME_UNKNOWNS, 2, FRAME_UNKNOWNS)
        _set_joints(J[:, :, 0], -turn.mT)
        _set_joints(J[:, :, 1], turn)
        J[:, POSE:, 0, POSE:], J[:, POSE:, 1, POSE:] = -torch.eye(3), torch.eye(3)
        root = torch.cat(
            [
                self.pose.velocity_weight.sqrt().repeat_interleave(3),
                step.new_full((3,), self.path.velocity_weight**0.5),
            ]
        )
        residual = torch.cat([step.flatten(1), path[1:] - path[:-1]], 1)
        return root * residual, root[:, None] * J.flatten(2)

    def _bend_rows(self, state: MotionState) -> Rows:
        """Accelerations of the path."""
        path, root = state.trans[0], self.path.acceleration_weight**0.5
        bend = path[:-2] - 2 * path[1:-1] + path[2:]
        J = bend.new_zeros(len(bend), 3, 3, FRAME_UNKNOWNS)
        for k, share in enumerate((1.0, -2.0, 1.0)):
            J[:, :, k, POSE:] = share * torch.eye(3)
        return root * bend, root * J.flatten(2)

    @cached_property
    def moves(self) -> list[Tensor]:
        """(m, n) of each kind of row: where derivatives can be other than 0."""
        points = self.image[0].body.keypoints.moved_by.repeat_interleave(3, 1)  # (K, 72)
        views = sum(len(term.views) for term in self.image)
        image = points.repeat_interleave(2, 0).repeat(views, 1)
        image = torch.cat([image, torch.ones(len(image), 3, dtype=torch.bool)], 1)
        prior = torch.zeros(POSE - 2, FRAME_UNKNOWNS, dtype=torch.bool)
        prior[: POSE - 3, 3:POSE] = True
        joints = torch.block_diag(*[torch.ones(3, 3)] * JOINTS, torch.eye(3)).bool()
        path = torch.zeros(3, FRAME_UNKNOWNS, dtype=torch.bool)
        path[:, POSE:] = torch.eye(3, dtype=torch.bool)
        return [torch.cat([image, prior]), joints.repeat(1, 2), path.repeat(1, 3)]


def motion_alone(made: MadeScene, options: MotionParams) -> MotionAlone:
    """The motion of a made scene's first common fit from where that fit starts, with the cameras
    and the shape that it ends with."""
    terms, start = first_common_problem(made, options, rigid_offsets=False)
    whole = newton(terms, start).state
    (prior,) = (term for term in terms if isinstance(term, PosePriorTerm))
    (pose,) = (term for term in terms if isinstance(term, PoseSmoothness))
    (path,) = (term for term in terms if isinstance(term, PathSmoothness))
    return MotionAlone(
        MotionState.of(start.R_local, start.trans, whole.betas, start.valid),
        tuple(_with_known_cameras(term, whole) for term in terms if isinstance(term, Reprojection)),
        prior,
        replace(pose, acceleration_weight=torch.zeros_like(pose.acceleration_weight)),
        path,
    )


def _with_known_cameras(term: Reprojection, solved: MotionState) -> Reprojection:
    views = (view.with_camera_of(solved) for view in term.views)
    return replace(term, views=tuple(replace(view, camera=None) for view in views))


def _image_rows(term: Reprojection, state: MotionState) -> Rows:
    points = term.body.derivatives(term.body.keypoints, state)
    residuals, derivatives = [], []
    for view in term.views:
        pixels, x_cam = project(view, points.xyz)
        root = view.weight.sqrt()[..., None]
        e = root * (pixels - view.xy_px)
        by_point = root[..., None] * projection_jacobian(view, x_cam) @ view.R[:, None, None]
        whole = term.scale**2 + e.square().sum(-1, keepdim=True)
        share = term.scale / whole.sqrt()
        along = (e[..., None, :] @ by_point) / whole[..., None]  # (1, T, K, 1, 3)
        by_point = share[..., None] * (by_point - e[..., None] * along)
        J = torch.cat([by_point @ points.d_pose, by_point], -1)
        residuals.append((share * e)[0].flatten(1))
        derivatives.append(J[0].flatten(1, 2))
    return torch.cat(residuals, 1), torch.cat(derivatives, 1)


def _prior_rows(term: PosePriorTerm, state: MotionState) -> Rows:
    """The whitened distance to the best component, and the root of its constant."""
    theta = state.axis_angle[0, :, 1:]
    _, best = term.prior.best(theta.flatten(1))
    factor = torch.linalg.cholesky(term.prior.precision)[best].mT * term.weight**0.5
    away = theta.flatten(1) - term.prior.mean[best]
    constant = (term.weight * term.prior.constant[best]).sqrt()
    pull = factor.unflatten(2, (JOINTS - 1, 3)).transpose(1, 2) @ inverse_right_jacobian(theta)
    J = away.new_zeros(len(away), POSE - 2, FRAME_UNKNOWNS)
    J[:, :-1, 3:POSE] = pull.transpose(1, 2).flatten(2)
    return torch.cat([(factor @ away[..., None])[..., 0], constant[:, None]], 1), J


def _set_joints(target: Float[Tensor, "N m n"], blocks: Float[Tensor, "N 24 3 3"]) -> None:
    """Write 3 x 3 blocks on the diagonal of the first 72 rows and columns."""
    for j in range(JOINTS):
        of_joint = slice(3 * j, 3 * j + 3)
        target[:, of_joint, of_joint] = blocks[:, j]


def _by_chart(J: Tensor, chart: Tensor) -> Tensor:
    """Derivatives by local increments of consecutive frames, as by the increments of the start."""
    count = J.shape[2] // FRAME_UNKNOWNS
    parts = J.unflatten(2, (count, FRAME_UNKNOWNS)).unbind(2)
    return torch.cat([part @ chart[k : k + len(J)] for k, part in enumerate(parts)], 2)
