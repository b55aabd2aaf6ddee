"""L-BFGS, a general quasi-Newton method, for comparison with Gauss-Newton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import OptimizeResult, minimize
from torch import Tensor

from imocap_core.motion.gauss_newton import Solution, objective
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms.base import Term

MEMORY = 20  # pairs of steps and gradients that approximate the curvature
STEPS_A_CENTRE = 100  # before the increments start again from the current state
SETTLED, MORE, STUCK = 0, 1, 2  # how SciPy's L-BFGS-B ends


def lbfgs(
    terms: Sequence[Term],
    state: MotionState,
    *,
    max_steps: int,
    relative_tolerance: float = 1e-6,
    shared_globals: bool = False,
) -> Solution:
    """L-BFGS (Liu & Nocedal, 1989) on local increments, with a strong Wolfe line search.

    Only points that lower the objective are taken, so it never rises. The increments are about
    one state for `STEPS_A_CENTRE` steps, then about the state reached: rotations stay far from the
    end of their chart, and the memory of the curvature starts again. It also starts again when a
    line search fails, as it can where a term's gradient is not exact (unknowns that a term
    minimises out are held constant in it).

    Args:
        terms: the objective; state: the start.
        max_steps: accepted steps at most.
        relative_tolerance: it has converged when a step lowers the objective by less than this
            share.
        shared_globals: one body for the batch.
    """
    costs, ended, moved = [float(objective(terms, state).sum())], MORE, True
    while ended != SETTLED and moved and len(costs) <= max_steps:
        chart = _Chart(terms, state, shared_globals)
        most = min(STEPS_A_CENTRE, max_steps + 1 - len(costs))
        state, lower, ended = _run(chart, costs[-1], most, relative_tolerance)
        costs += lower
        moved = bool(lower)
    steps = len(costs) - 1
    status = {
        SETTLED: f"L-BFGS converged after {steps} steps",
        MORE: f"L-BFGS stopped after {steps} steps before it converged",
        STUCK: f"L-BFGS stopped after {steps} steps, where its line search found nothing lower",
    }[ended]
    converged = torch.full_like(state.valid[:, 0], ended == SETTLED)
    return Solution(state, costs, converged, status)


@dataclass(frozen=True)
class _Chart:
    """The objective as a function of a flat vector: increments about a state."""

    terms: Sequence[Term]
    centre: MotionState
    shared_globals: bool

    @property
    def sizes(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Shapes of the frames' unknowns and of the globals."""
        batch, frames = self.centre.valid.shape
        rows = 1 if self.shared_globals else batch
        return (batch, frames, FRAME_UNKNOWNS), (rows, self.centre.unknown_globals)

    def state(self, x: Float[Tensor, " n"]) -> MotionState:
        """The centre after increments."""
        of_frames, of_globals = self.sizes
        count = int(np.prod(of_frames))
        d_globals = x[count:].reshape(of_globals).expand(len(self.centre.valid), -1)
        return self.centre.retract(x[:count].reshape(of_frames), d_globals)

    def tensor(self, x: Float[np.ndarray, " n"]) -> Float[Tensor, " n"]:
        """On the centre's device, in its dtype."""
        return torch.as_tensor(x).to(self.centre.trans)

    def value(self, x: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """The objective and its gradient; a very high value without slope where it is not
        finite."""
        point = self.tensor(x).requires_grad_()
        cost = objective(self.terms, self.state(point)).sum()
        (gradient,) = torch.autograd.grad(cost, point)
        if not (bool(cost.isfinite()) and bool(gradient.isfinite().all())):
            return float(np.finfo(np.float32).max), np.zeros_like(x)
        return float(cost.detach()), gradient.cpu().numpy().astype(np.float64)


def _run(
    chart: _Chart, start_cost: float, most: int, tolerance: float
) -> tuple[MotionState, list[float], int]:
    """The lowest state of up to ``most`` steps about one centre, the objective after each, and
    SciPy's exit code."""
    best = np.zeros(sum(int(np.prod(size)) for size in chart.sizes))
    costs = [start_cost]

    def taken(intermediate_result: OptimizeResult) -> None:
        nonlocal best
        if intermediate_result.fun < costs[-1]:
            best = np.array(intermediate_result.x)
            costs.append(float(intermediate_result.fun))

    ended = minimize(
        chart.value,
        best,
        jac=True,
        method="L-BFGS-B",
        callback=taken,
        options={
            "maxiter": most,
            "maxfun": 20 * most,
            "maxcor": MEMORY,
            "ftol": tolerance,
            "gtol": 0.0,
        },
    )
    return chart.state(chart.tensor(best)), costs[1:], int(ended.status)
