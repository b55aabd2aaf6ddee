"""SciPy's `least_squares` and Ceres on a motion alone: one problem, start and target for all."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.sparse import coo_matrix, csr_matrix

from benchmarks.solver.race import NEWTON, NEWTON_STEPS, NEWTON_TOLERANCE, TARGET, RaceOver, timed
from benchmarks.speed.motion_alone import MotionAlone
from imocap_core.motion.gauss_newton import Solution, gauss_newton
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms.base import Term

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
            raise RaceOver
        return u

    def jacobian(x: Float[np.ndarray, " n"]) -> csr_matrix:
        return pattern.matrix([J.numpy() for _, J in problem.rows(x)])

    start = np.zeros(problem.frames * FRAME_UNKNOWNS)
    with suppress(RaceOver):
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
    return timed(
        "", NEWTON, gauss_newton_alone, problem.terms, problem.start, target, np.inf
    ).seconds


def gauss_newton_alone(terms: Sequence[Term], start: MotionState) -> Solution:
    """Gauss-Newton until it has converged, the shape held."""
    return gauss_newton(
        terms, start, max_steps=NEWTON_STEPS, relative_tolerance=NEWTON_TOLERANCE, free_shape=False
    )


def motion_race(problem: MotionAlone, rival: Race, most_times: float) -> tuple[float, Stopwatch]:
    """Our time until an objective that is 0.1 % above our lowest, the median of before and after,
    and the rival's; it is stopped at ``most_times`` of ours."""
    target = TARGET * gauss_newton_alone(problem.terms, problem.start).costs[-1]
    ours = [gauss_newton_s(problem, target) for _ in range(TIMES)]
    watch = Stopwatch(target, most_times * max(ours))
    rival(problem, watch)
    ours += [gauss_newton_s(problem, target) for _ in range(TIMES)]
    return float(np.median(ours)), watch
