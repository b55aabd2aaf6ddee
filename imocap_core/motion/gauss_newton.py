"""Damped Gauss-Newton (Levenberg-Marquardt) with guaranteed descent: residuals, not bodies.

A problem is a batch of rows, each accepted or rejected by itself, so that no row's cost ever rises.
A rejected row is tried again with more damping; the equations are set up anew as soon as any row
has moved.

A batch is split into its motions, each of its own length. Motions that share their globals step
together; others are solved separately and stop when they have converged. On a CPU every motion has
a thread, and a single motion has one for each half of its work: the blocks are too small for a
linear algebra library's own threads to pay. Of long ones fewer are worked on at once, and their
equations are factored in place: memory is bounded by the longest, steps are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.motion.normal import NormalEquations, Reduced, solve_globals
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms.base import Term
from imocap_core.workers import MapFn, cores, on, serial_map

FIRST_DAMPING, LEAST_DAMPING, LARGEST_DAMPING = 1e-3, 1e-9, 1e6
EASE, STIFFEN = 5.0, 8.0  # factors of the damping after a step down, and after a rejected one

State = TypeVar("State")
Equations = TypeVar("Equations")


@runtime_checkable
class LeastSquares(Protocol[State, Equations]):
    """A nonlinear least-squares problem of B rows."""

    def cost(self, state: State) -> Float[np.ndarray, " B"]:
        """The objective of each row."""

    def linearise(self, state: State) -> Equations:
        """The normal equations of all rows at a state."""

    def trial(self, state: State, equations: Equations, damping: Float[np.ndarray, " B"]) -> State:
        """The state after the damped step (Marquardt's scaling)."""

    def choose(self, better: Bool[np.ndarray, " B"], trial: State, state: State) -> State:
        """The trial in the rows that are better there, else the state."""


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


HALVES = 2  # parts in which the terms of a single motion are worked on at the same time


def objective(terms: Sequence[Term], state: MotionState) -> Float[Tensor, " B"]:
    """Sum of all terms' costs."""
    return torch.stack([term.cost(state) for term in terms]).sum(0)


def linearise(terms: Sequence[Term], state: MotionState) -> NormalEquations:
    """The normal equations of all terms at ``state``; padded frames get the identity."""
    return _with_padding(_of_terms(terms, state), state)


def _of_terms(terms: Sequence[Term], state: MotionState) -> NormalEquations:
    batch, frames = state.valid.shape
    normal = NormalEquations.zeros(
        batch, frames, FRAME_UNKNOWNS, state.unknown_globals, state.trans
    )
    for term in terms:
        term.add_to(normal, state)
    return normal


def _with_padding(normal: NormalEquations, state: MotionState) -> NormalEquations:
    torch.diagonal(normal.diagonal, dim1=-2, dim2=-1).add_(
        (~state.valid)[..., None].to(state.trans)
    )
    return normal


def linearise_halves(terms: Sequence[Term], state: MotionState, each: MapFn) -> NormalEquations:
    """`linearise`, every second term by itself."""
    halves = [terms[k::HALVES] for k in range(min(HALVES, len(terms)))]
    first, *others = each(lambda half: _of_terms(half, state), halves)
    normal: NormalEquations = first
    for other in others:
        normal = normal.plus(other)
    return _with_padding(normal, state)


MOST_HELD = 3072  # frames whose normal equations or factors are in memory at once: 0.5 GB


@dataclass(frozen=True)
class Solution:
    """Where the solver stopped.

    Attributes:
        state: of the lowest objective.
        costs: objective of the whole batch, at the start and after each step.
        converged: (B,); status: one sentence.
    """

    state: MotionState
    costs: list[float]
    converged: Bool[Tensor, " B"]
    status: str


@dataclass(frozen=True)
class SolverMotion:
    """One motion of a batch (batch of 1, without padding) and its part of every term."""

    terms: list[Term]
    state: MotionState

    def cost(self, each: MapFn = serial_map) -> float:
        """Its objective; ``each`` runs the terms."""
        costs = each(lambda term: term.cost(self.state), self.terms)
        return float(torch.stack(costs).sum())


def gauss_newton(
    terms: Sequence[Term],
    state: MotionState,
    *,
    max_steps: int,
    relative_tolerance: float = 1e-4,
    shared_globals: bool = False,
    free_shape: bool = True,
    bodies: Sequence[int] | None = None,
) -> Solution:
    """Levenberg-Marquardt on the block-banded system.

    A step that raises the objective is rejected and its damping grows, so the objective never
    rises. With ``shared_globals`` the batch is one body: it is accepted or rejected together and
    must start with equal betas.

    Args:
        terms: the objective; state: the start.
        max_steps: linearisations at most.
        relative_tolerance: a motion has converged when a step lowers its objective by less than
            this share.
        shared_globals: one body for the batch; free_shape: False holds the betas.
        bodies: number of each motion's body; with ``shared_globals``, those of one body alone
            share their globals.
    """
    motions = split_batch(terms, state)
    count, longest = state.valid.shape
    at_once = min(count, cores(), motions_at_once(longest))
    workers = 1 if state.trans.is_cuda else min(cores(), max(at_once, HALVES))
    of_motion = (bodies or [0] * count) if shared_globals else range(count)
    rows = [[v for v, b in enumerate(of_motion) if b == body] for body in dict.fromkeys(of_motion)]
    with ThreadPoolExecutor(workers) as pool:
        apart = not shared_globals and at_once > 1
        threads = on(pool) if workers > 1 else serial_map

        def bring_down(row: list[int]) -> Descent[list[SolverMotion]]:
            group = [motions[v] for v in row]
            each = serial_map if apart else threads
            problem = _OneBody.of(group, each, free_shape, at_once, at_once * longest, count == 1)
            return descend(problem, group, max_steps=max_steps, tolerance=relative_tolerance)

        descents = (threads if apart else serial_map)(bring_down, rows)
    solved = {
        v: (motion.state, bool(descent.converged[0]))
        for row, descent in zip(rows, descents, strict=True)
        for v, motion in zip(row, descent.state, strict=True)
    }
    minima = [solved[v][0] for v in range(len(motions))]
    steps = max(len(d.costs) for d in descents)
    costs = [
        float(sum(d.costs[min(k, len(d.costs) - 1)][0] for d in descents)) for k in range(steps)
    ]
    converged = [solved[v][1] for v in range(len(motions))]
    status = (
        f"converged after {steps - 1} steps"
        if all(converged)
        else f"stopped after {max_steps} steps before every motion converged"
    )
    flags = torch.tensor(converged, device=state.valid.device)
    return Solution(merge_batch(state, minima), costs, flags, status)


def motions_at_once(frames: int) -> int:
    """Motions of so many frames whose normal equations may be in memory at the same time."""
    return max(1, MOST_HELD // max(frames, 1))


def split_batch(terms: Sequence[Term], state: MotionState) -> list[SolverMotion]:
    """The motions of a batch, each without its padding."""
    lengths = state.valid.sum(1).tolist()
    return [
        SolverMotion([term.of(v, n) for term in terms], state.of_motion(v, n))
        for v, n in enumerate(lengths)
    ]


def merge_batch(batch: MotionState, motions: Sequence[MotionState]) -> MotionState:
    """The batch with its motions replaced; padding stays."""
    R_local, trans = batch.R_local.clone(), batch.trans.clone()
    for v, motion in enumerate(motions):
        length = motion.valid.shape[1]
        R_local[v, :length], trans[v, :length] = motion.R_local[0], motion.trans[0]
    return replace(
        batch,
        R_local=R_local,
        trans=trans,
        betas=torch.cat([m.betas for m in motions]),
        camera_R=torch.cat([m.camera_R for m in motions]),
        camera_t=torch.cat([m.camera_t for m in motions]),
        log_focal=torch.cat([m.log_focal for m in motions]),
        scores=torch.cat([m.scores for m in motions]),
        other_betas=torch.cat([m.other_betas for m in motions]),
    )


@dataclass(frozen=True)
class _OneBody:
    """Motions whose globals move as one, as the one row of a descent.

    Attributes:
        each: runs the motions; within: the halves of a single one.
        alone: whether a single motion is all there is: its terms are added in halves, wherever
            these run, so that a result does not depend on the number of cores.
        held: whether the normal equations of all motions are kept until a step is accepted. If
            not, each motion's are set up, factored in place and dropped, and once more after a
            rejected step.
        factored: whether the factors of all motions are kept until the globals are known.
    """

    each: MapFn
    within: MapFn
    free_shape: bool
    held: bool
    factored: bool
    alone: bool

    @classmethod
    def of(
        cls,
        motions: Sequence[SolverMotion],
        each: MapFn,
        free_shape: bool,
        at_once: int,
        frames: int,
        alone: bool,
    ) -> "_OneBody":
        """``each`` runs the halves of the motions where these are worked on one by one.

        Args:
            at_once: motions that are worked on at the same time; frames: of all of these.
            alone: whether the motion is the only one that is fitted.
        """
        of_body = sum(motion.state.valid.shape[1] for motion in motions)
        factored = 2 * of_body <= MOST_HELD
        most = max(of_body, frames)
        held = most + (most if factored else frames) <= MOST_HELD  # equations and factors
        if len(motions) == 1 or at_once == 1:
            return cls(serial_map, each, free_shape, held, factored, alone)
        return cls(each, serial_map, free_shape, held, factored, alone)

    def cost(self, state: list[SolverMotion]) -> Float[np.ndarray, "1"]:
        """Sum of the motions' objectives."""
        return np.array([sum(self.each(partial(SolverMotion.cost, each=self.within), state))])

    def linearise(self, state: list[SolverMotion]) -> list[NormalEquations | None]:
        """The normal equations of every motion; None where they are not held."""
        if not self.held:
            return [None] * len(state)
        systems: list[NormalEquations | None] = self.each(self._system, state)
        return systems

    def trial(
        self,
        state: list[SolverMotion],
        equations: list[NormalEquations | None],
        damping: Float[np.ndarray, "1"],
    ) -> list[SolverMotion]:
        """Every motion moved, the globals by one and the same step."""
        factor = float(damping[0])
        pairs = list(zip(state, equations, strict=True))
        reduced = self.each(partial(self._reduced, damping=factor), pairs)
        d_globals = solve_globals(reduced, factor).nan_to_num()
        return self.each(
            partial(_moved, d_globals=d_globals), list(zip(state, reduced, strict=True))
        )

    def _system(self, motion: SolverMotion) -> NormalEquations:
        if self.alone and self.held:  # halves are two systems until they are added
            normal = linearise_halves(motion.terms, motion.state, self.within)
        else:
            normal = linearise(motion.terms, motion.state)
        return normal if self.free_shape else _with_held_shape(normal, motion.state)

    def _reduced(
        self, pair: tuple[SolverMotion, NormalEquations | None], damping: float
    ) -> Reduced:
        motion, equations = pair
        if equations is None:
            system = self._system(motion)
            motion.state.forget()  # wanted again only where the step is rejected
            return system.reduce(damping, in_place=True, factored=self.factored)
        return equations.reduce(damping, factored=self.factored)

    def choose(
        self, better: Bool[np.ndarray, "1"], trial: list[SolverMotion], state: list[SolverMotion]
    ) -> list[SolverMotion]:
        """All motions are accepted or rejected together."""
        return trial if better[0] else state


def _with_held_shape(normal: NormalEquations, state: MotionState) -> NormalEquations:
    shape = slice(0, state.betas.shape[1])
    normal.border[..., shape] = 0.0
    normal.corner[:, shape] = normal.corner[:, :, shape] = 0.0
    normal.corner_gradient[:, shape] = 0.0
    return normal


def _moved(pair: tuple[SolverMotion, Reduced], d_globals: Tensor) -> SolverMotion:
    motion, reduced = pair
    d_frames = reduced.frames(d_globals[None]).nan_to_num()
    return replace(motion, state=motion.state.retract(d_frames, d_globals[None]))
