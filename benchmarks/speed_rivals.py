"""Automatic differentiation of the body, which `imocap benchmark speed` is compared with."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.optimize import least_squares
from scipy.sparse import coo_matrix, csr_matrix
from torch import Tensor

from benchmarks import solver_race
from imocap_core.body import Model, PointSet
from imocap_core.motion.gauss_newton import Solution, gauss_newton
from imocap_core.motion.state import FRAME_UNKNOWNS, POSE, MotionState
from imocap_core.motion.terms import PathSmoothness, PosePriorTerm, PoseSmoothness, Reprojection
from imocap_core.motion.terms.base import Term
from imocap_core.motion.terms.view import project, projection_jacobian
from imocap_core.params import MotionParams
from imocap_core.rotations import exp, inverse_right_jacobian, log, right_jacobian

LAYOUT = "body25"


def automatic_jacobian(
    model: Model, points: PointSet
) -> Callable[[Tensor, Tensor, Tensor], object]:
    """Forward-mode Jacobian of each body's keypoints by its pose, shape and translation."""

    def place(theta: Tensor, betas: Tensor, transl: Tensor) -> Tensor:
        return model.shape(betas).pose(exp(theta), transl).keypoints(points)

    jacobian = torch.func.jacfwd(place, argnums=(0, 1, 2))
    return torch.func.vmap(jacobian, in_dims=(0, None, 0))


# The plain ways: what one writes first, with the same answers.


def procrustes_by_svd(
    poses_a: Float[np.ndarray, "N_a J 3"], poses_b: Float[np.ndarray, "N_b J 3"]
) -> Float[np.ndarray, "N_a N_b"]:
    """Root-mean-square joint distance of every pair after the best rigid alignment, each by a
    singular value decomposition (Kabsch 1976)."""
    centred_a = poses_a - poses_a.mean(axis=1, keepdims=True)
    centred_b = poses_b - poses_b.mean(axis=1, keepdims=True)
    out = np.empty((len(poses_a), len(poses_b)))
    for i, a in enumerate(centred_a):
        for j, b in enumerate(centred_b):
            U, S, Vt = np.linalg.svd(a.T @ b)
            S[2] *= np.sign(np.linalg.det(U @ Vt))
            square = (a**2).sum() + (b**2).sum() - 2 * S.sum()
            out[i, j] = np.sqrt(max(square, 0.0) / len(a))
    return out


def dtw_by_loops(
    a: Float[np.ndarray, " N"], b: Float[np.ndarray, " S"]
) -> tuple[Int[np.ndarray, "L 2"], float]:
    """The cheapest monotone path between two series, squared differences, a diagonal step
    weighing two; the path and its cost."""
    x, y = a.tolist(), b.tolist()
    n, m = len(x), len(y)
    total = [[0.0] * m for _ in range(n)]
    step = [[(0, 0)] * m for _ in range(n)]
    for i in range(n):
        for j in range(m):
            cost = (x[i] - y[j]) ** 2
            options = []
            if i and j:
                options.append((total[i - 1][j - 1] + 2 * cost, (1, 1)))
            if i:
                options.append((total[i - 1][j] + cost, (1, 0)))
            if j:
                options.append((total[i][j - 1] + cost, (0, 1)))
            total[i][j], step[i][j] = min(options) if options else (2 * cost, (0, 0))
    i, j = n - 1, m - 1
    path = [(i, j)]
    while (i, j) != (0, 0):
        i, j = i - step[i][j][0], j - step[i][j][1]
        path.append((i, j))
    return np.array(path[::-1], dtype=np.int64), total[n - 1][m - 1]


# A motion with known cameras and shape as residuals, for solvers that need them one by one.
#
# The terms of the objective give costs and normal equations. Here the same costs are squared norms
# of residuals: ``u = r sqrt(rho(s) / s)`` of a robust loss rho with ``s = r^2``, so that ``|u|^2 =
# rho``, and the pose prior's whitened distance. Left out of the whole problem are cameras, shape,
# and the terms without a simple root (accelerations of joints, limits).

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


def motion_alone(made: solver_race.MadeScene, options: MotionParams) -> MotionAlone:
    """The motion of a made scene's first common fit from where that fit starts, with the cameras
    and the shape that it ends with."""
    terms, start = solver_race.first_common_problem(made, options, rigid_offsets=False)
    whole = solver_race.newton(terms, start).state
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


# SciPy's `least_squares` and Ceres on a motion alone: one problem, start and target for all.

MANY_STEPS = 100_000
TIMES = 2  # of ours, before and after a rival


@dataclass
class Stopwatch:
    """Processor time until the target.

    lowest: the objective so far; left_out_s: not counted; ended_s: when last asked whether it is
    over.
    """

    target: float
    limit_s: float
    began: float = field(default_factory=time.process_time)
    lowest: float = float("inf")
    left_out_s: float = 0.0
    ended_s: float = float("nan")

    @property
    def reached(self) -> bool:
        """Whether the target is."""
        return self.lowest <= self.target

    @property
    def spent_s(self) -> float:
        """Since the start, without what is left out."""
        return time.process_time() - self.began - self.left_out_s

    @contextmanager
    def stopped(self) -> Iterator[None]:
        """The time of the body is not counted."""
        began = time.process_time()
        yield
        self.left_out_s += time.process_time() - began

    def is_over(self, objective: float) -> bool:
        """Whether the target is reached, or the time is up."""
        self.lowest, self.ended_s = min(self.lowest, objective), self.spent_s
        return self.reached or self.ended_s > self.limit_s


Race = Callable[[MotionAlone, Stopwatch], None]


def scipy_solve(problem: MotionAlone, watch: Stopwatch) -> None:
    """Trust region reflective with a sparse Jacobian, its steps by LSMR."""
    pattern = SparsePattern.of(problem)

    def residuals(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
        u = np.concatenate([r.numpy().ravel() for r, _ in problem.rows(x)])
        if watch.is_over(float(u @ u)):
            raise solver_race.RaceOver
        return u

    def jacobian(x: Float[np.ndarray, " n"]) -> csr_matrix:
        return pattern.matrix([J.numpy() for _, J in problem.rows(x)])

    start = np.zeros(problem.frames * FRAME_UNKNOWNS)
    with suppress(solver_race.RaceOver):
        least_squares(
            residuals, start, jacobian, method="trf", tr_solver="lsmr", x_scale="jac",
            ftol=1e-12, xtol=1e-12, gtol=1e-12, max_nfev=MANY_STEPS,
        )  # fmt: skip


@dataclass(frozen=True)
class SparsePattern:
    """Where the Jacobian has entries; masks: of each kind of row."""

    masks: list[np.ndarray]
    order: np.ndarray
    frame: csr_matrix

    @classmethod
    def of(cls, problem: MotionAlone) -> SparsePattern:
        """Frames, pairs and triples, as `MotionAlone.rows` has them."""
        rows, columns, first = [], [], 0
        masks = [mask.numpy() for mask in problem.moves]
        for span, mask in enumerate(masks):
            row, column = np.nonzero(mask)
            for k in range(problem.frames - span):
                rows.append(first + k * len(mask) + row)
                columns.append(k * FRAME_UNKNOWNS + column)
            first += len(mask) * (problem.frames - span)
        row, column = np.concatenate(rows), np.concatenate(columns)
        shape = (first, problem.frames * FRAME_UNKNOWNS)
        numbers = coo_matrix((np.arange(1.0, len(row) + 1), (row, column)), shape).tocsr()
        return cls(masks, numbers.data.astype(int) - 1, numbers)

    def matrix(self, blocks: list[Float[np.ndarray, "..."]]) -> csr_matrix:
        """The Jacobian of the rows' derivatives."""
        data = np.concatenate([J[:, m].ravel() for J, m in zip(blocks, self.masks, strict=True)])
        frame = self.frame
        return csr_matrix((data[self.order], frame.indices, frame.indptr), frame.shape)


def ceres_solve(problem: MotionAlone, watch: Stopwatch) -> None:
    """Levenberg-Marquardt with a sparse Cholesky factorisation, through pyceres.

    pyceres asks for every frame's residuals by a call of its own, which in Python takes far longer
    than for all at once: their time is not counted. The first radius is 1: with its default of
    10,000 it ended in another minimum, with 100 it took longer.
    """
    ceres = import_module("pyceres")
    x = np.zeros((problem.frames, FRAME_UNKNOWNS))

    class Part(ceres.CostFunction):  # type: ignore[misc, name-defined]
        """The rows of one frame, pair or triple."""

        def __init__(self, kind: int, first: int, size: int) -> None:
            super().__init__()
            self.kind, self.part = kind, problem.part(first, kind + 1)
            self.set_num_residuals(size)
            self.set_parameter_block_sizes([FRAME_UNKNOWNS] * (kind + 1))

        def Evaluate(self, parameters: Any, residuals: Any, jacobians: Any) -> bool:
            with watch.stopped():
                ((rows, derivatives),) = self.part.rows(np.concatenate(parameters), [self.kind])
            residuals[:] = rows[0].numpy()
            for i, target in enumerate(jacobians or []):
                if target is not None:
                    of_frame = slice(i * FRAME_UNKNOWNS, (i + 1) * FRAME_UNKNOWNS)
                    target[:] = derivatives[0, :, of_frame].numpy().ravel()
            return True

    class Watched(ceres.IterationCallback):  # type: ignore[misc, name-defined]
        """Ends the race; Ceres's cost is half of the objective."""

        def __call__(self, summary: Any) -> Any:
            over = watch.is_over(2.0 * summary.cost)
            kind = ceres.CallbackReturnType
            return kind.SOLVER_TERMINATE_SUCCESSFULLY if over else kind.SOLVER_CONTINUE

    watched, costs, task = Watched(), list[Any](), ceres.Problem()
    for kind, mask in enumerate(problem.moves):
        for k in range(problem.frames - kind):
            costs.append(Part(kind, k, len(mask)))
            task.add_residual_block(costs[-1], None, [x[k + i] for i in range(kind + 1)])
    chosen, summary = ceres.SolverOptions(), ceres.SolverSummary()
    chosen.linear_solver_type = ceres.LinearSolverType.SPARSE_NORMAL_CHOLESKY
    chosen.max_num_iterations, chosen.num_threads = MANY_STEPS, 1
    chosen.initial_trust_region_radius = 1.0
    chosen.function_tolerance = chosen.parameter_tolerance = chosen.gradient_tolerance = 1e-12
    chosen.logging_type = ceres.LoggingType.SILENT
    chosen.callbacks = [watched]
    ceres.solve(chosen, task, summary)


def gauss_newton_s(problem: MotionAlone, target: float) -> float:
    """Processor time of ours until the target."""
    return solver_race.timed(
        "", solver_race.NEWTON, gauss_newton_alone, problem.terms, problem.start, target, np.inf
    ).seconds


def gauss_newton_alone(terms: Sequence[Term], start: MotionState) -> Solution:
    """Gauss-Newton until it has converged, the shape held."""
    return gauss_newton(
        terms,
        start,
        max_steps=solver_race.NEWTON_STEPS,
        relative_tolerance=solver_race.NEWTON_TOLERANCE,
        free_shape=False,
    )


def motion_race(problem: MotionAlone, rival: Race, most_times: float) -> tuple[float, Stopwatch]:
    """Our time until an objective that is 0.1 % above our lowest, the median of before and after,
    and the rival's; it is stopped at ``most_times`` of ours."""
    target = solver_race.TARGET * gauss_newton_alone(problem.terms, problem.start).costs[-1]
    ours = [gauss_newton_s(problem, target) for _ in range(TIMES)]
    watch = Stopwatch(target, most_times * max(ours))
    rival(problem, watch)
    ours += [gauss_newton_s(problem, target) for _ in range(TIMES)]
    return float(np.median(ours)), watch
