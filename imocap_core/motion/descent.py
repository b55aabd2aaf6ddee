"""Levenberg-Marquardt descent: damping, acceptance and convergence, whatever is being fitted.

A problem is a batch of rows, each accepted or rejected by itself, so that no row's cost ever rises.
A rejected row is tried again with more damping; the equations are set up anew as soon as any row
has moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

FIRST_DAMPING, LEAST_DAMPING, LARGEST_DAMPING = 1e-3, 1e-9, 1e6
EASE, STIFFEN = 5.0, 8.0  # factors of the damping after a step down, and after a rejected one

State = TypeVar("State")
Equations = TypeVar("Equations")


@runtime_checkable
class LeastSquares(Protocol[State, Equations]):
    """A nonlinear least-squares problem of B rows."""

    def cost(self, state: State) -> Float[np.ndarray, " B"]:
        """The objective of each row."""
        ...

    def linearise(self, state: State) -> Equations:
        """The normal equations of all rows at a state."""
        ...

    def trial(self, state: State, equations: Equations, damping: Float[np.ndarray, " B"]) -> State:
        """The state after the damped step (Marquardt's scaling)."""
        ...

    def choose(self, better: Bool[np.ndarray, " B"], trial: State, state: State) -> State:
        """The trial in the rows that are better there, else the state."""
        ...


@dataclass(frozen=True)
class Descent(Generic[State]):
    """Where a descent ended.

    Attributes:
        state: of the lowest cost in every row.
        costs: of the rows, at the start and after each set of equations.
        converged: rows that stopped by themselves, not for lack of steps.
    """

    state: State
    costs: list[Float[np.ndarray, " B"]]
    converged: Bool[np.ndarray, " B"]


def descend(
    problem: LeastSquares[State, Equations], start: State, *, max_steps: int, tolerance: float
) -> Descent[State]:
    """Minimise every row's cost from a start.

    Args:
        max_steps: sets of normal equations at most.
        tolerance: a row has converged when a step lowers its cost by a smaller share than this, or
            when no damping up to `LARGEST_DAMPING` lowers it.
    """
    cost = problem.cost(start)
    now = _Progress(start, cost, np.full_like(cost, FIRST_DAMPING), np.zeros(len(cost), bool))
    costs = [cost]
    for _ in range(max_steps):
        now = _step(problem, now, tolerance)
        costs.append(now.cost)
        if now.converged.all():
            break
    return Descent(now.state, costs, now.converged)


@dataclass(frozen=True)
class _Progress(Generic[State]):
    state: State
    cost: np.ndarray
    damping: np.ndarray
    converged: np.ndarray


def _step(
    problem: LeastSquares[State, Equations], now: _Progress[State], tolerance: float
) -> _Progress[State]:
    """What one set of equations gives; they end here, being most of the memory in use."""
    equations = problem.linearise(now.state)
    damping, converged = now.damping, now.converged
    while True:
        trial = problem.trial(now.state, equations, damping)
        trial_cost = problem.cost(trial)
        better = ~converged & (trial_cost < now.cost)  # NaN is never better
        small = better & ~(now.cost - trial_cost > tolerance * now.cost)
        eased = np.maximum(damping / EASE, LEAST_DAMPING)
        damping = np.where(better, eased, np.where(converged, damping, damping * STIFFEN))
        converged = converged | small | (damping > LARGEST_DAMPING)
        if better.any():
            state = problem.choose(better, trial, now.state)
            return _Progress(state, np.where(better, trial_cost, now.cost), damping, converged)
        if converged.all():
            return _Progress(now.state, now.cost, damping, converged)
