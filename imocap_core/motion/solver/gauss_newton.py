"""Damped Gauss-Newton with guaranteed descent. It knows residuals, not bodies.

A batch is taken apart into its motions, each of its own length. Motions that share their globals
step together; others go their own way and stop when they have settled. On a CPU every motion has a
thread, and a motion alone has one for each half of its work: the blocks are too small for a linear
algebra library's own threads to pay.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations, Reduced, solve_globals
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms.base import Term
from imocap_core.workers import Each, cores, in_turn, on

FIRST_DAMPING = 1e-3
LEAST_DAMPING = 1e-9
LARGEST_DAMPING = 1e6
HALVES = 2  # of a motion alone


@dataclass(frozen=True)
class Solution:
    """Where the solver stopped.

    Attributes:
        state: the best state seen.
        costs: objective of the whole batch after each accepted or rejected step, first the start.
        converged: (B,) bool; status: one sentence.
    """

    state: MotionState
    costs: list[float]
    converged: Tensor
    status: str


@dataclass(frozen=True)
class Motion:
    """One motion of a batch (batch of 1, without padding) and its part of every term."""

    terms: list[Term]
    state: MotionState

    def cost(self, each: Each = in_turn) -> float:
        """Its objective; ``each`` does the terms."""
        costs = each(partial(_cost_of, state=self.state), self.terms)
        return float(torch.stack(costs).sum())


@dataclass(frozen=True)
class Descent:
    """How one group of motions came down."""

    motions: list[Motion]
    costs: list[float]
    converged: bool


def objective(terms: Sequence[Term], state: MotionState) -> Tensor:
    """(B,) sum of all terms."""
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


def linearise_halves(terms: Sequence[Term], state: MotionState, each: Each) -> NormalEquations:
    """`linearise`, every second term by itself."""
    halves = [terms[k::HALVES] for k in range(min(HALVES, len(terms)))]
    first, *others = each(lambda half: _of_terms(half, state), halves)
    normal: NormalEquations = first
    for other in others:
        normal = normal.plus(other)
    return _with_padding(normal, state)


def gauss_newton(
    terms: Sequence[Term],
    state: MotionState,
    *,
    max_steps: int,
    relative_tolerance: float = 1e-4,
    shared_globals: bool = False,
    free_shape: bool = True,
) -> Solution:
    """Levenberg-Marquardt on the block-banded system.

    A step that raises the objective is rejected and its damping grows, so the objective never
    rises. With ``shared_globals`` the batch is one body: it is accepted or rejected together and
    must start with equal betas.

    Args:
        terms: the objective; state: the start.
        max_steps: linearisations at most.
        relative_tolerance: a motion has converged when an accepted step lowers its objective by
            less than this share.
        shared_globals: one body for the batch; free_shape: False holds the betas.
    """
    motions = take_apart(terms, state)
    alone = len(motions) == 1
    most = HALVES if alone else len(motions)
    workers = 1 if state.trans.is_cuda else min(most, cores())
    with ThreadPoolExecutor(workers) as pool:

        def descend(group: list[Motion], each: Each) -> Descent:
            return _descend(group, each, max_steps, relative_tolerance, free_shape)

        if shared_globals or alone:
            descents = [descend(motions, on(pool))]
        else:
            groups = [[motion] for motion in motions]
            descents = on(pool)(lambda group: descend(group, in_turn), groups)
    found = [motion.state for descent in descents for motion in descent.motions]
    steps = max(len(d.costs) for d in descents)
    costs = [sum(d.costs[min(k, len(d.costs) - 1)] for d in descents) for k in range(steps)]
    settled = [d.converged for d in descents for _ in d.motions]
    status = (
        f"converged after {steps - 1} steps"
        if all(settled)
        else f"stopped after {max_steps} steps before every motion settled"
    )
    converged = torch.tensor(settled, device=state.valid.device)
    return Solution(put_together(state, found), costs, converged, status)


def take_apart(terms: Sequence[Term], state: MotionState) -> list[Motion]:
    """The motions of a batch, each without its padding."""
    lengths = state.valid.sum(1).tolist()
    return [
        Motion([term.of(v, n) for term in terms], state.of_motion(v, n))
        for v, n in enumerate(lengths)
    ]


def put_together(batch: MotionState, motions: Sequence[MotionState]) -> MotionState:
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
    )


def _descend(
    motions: list[Motion], each: Each, max_steps: int, tolerance: float, free_shape: bool
) -> Descent:
    """Bring down the sum of the motions' objectives; their globals move as one.

    ``each`` does the motions, or the halves of one alone.
    """
    each, within = (in_turn, each) if len(motions) == 1 else (each, in_turn)
    cost = float(sum(each(partial(Motion.cost, each=within), motions)))
    damping, costs, converged = FIRST_DAMPING, [cost], False
    for _ in range(max_steps):
        motions, lower, damping = _stepped_down(motions, cost, damping, free_shape, each, within)
        converged = not cost - lower > tolerance * cost  # NaN has nowhere to go
        cost = lower
        costs.append(cost)
        if converged:
            break
    return Descent(motions, costs, converged)


def _stepped_down(
    motions: list[Motion], cost: float, damping: float, free_shape: bool, each: Each, within: Each
) -> tuple[list[Motion], float, float]:
    """Motions after one step that lowers their objective, or as they were, it, and the damping to
    go on with. The normal equations, most of the memory in use, end here."""
    systems = each(partial(_system, free_shape=free_shape, each=within), motions)
    while damping <= LARGEST_DAMPING:
        reduced = each(partial(NormalEquations.reduce, damping=damping, each=within), systems)
        d_globals = solve_globals(reduced, damping).nan_to_num()
        pairs = list(zip(motions, reduced, strict=True))
        trial = each(partial(_moved, d_globals=d_globals), pairs)
        trial_cost = float(sum(each(partial(Motion.cost, each=within), trial)))
        if trial_cost < cost:  # NaN is never better
            return trial, trial_cost, max(damping / 5, LEAST_DAMPING)
        damping *= 8
    return motions, cost, damping


def _cost_of(term: Term, state: MotionState) -> Tensor:
    return term.cost(state)


def _system(motion: Motion, free_shape: bool, each: Each) -> NormalEquations:
    if each is in_turn:
        normal = linearise(motion.terms, motion.state)
    else:
        normal = linearise_halves(motion.terms, motion.state, each)
    if not free_shape:
        shape = slice(0, motion.state.betas.shape[1])
        normal.border[..., shape] = 0.0
        normal.corner[:, shape] = normal.corner[:, :, shape] = 0.0
        normal.corner_gradient[:, shape] = 0.0
    return normal


def _moved(pair: tuple[Motion, Reduced], d_globals: Tensor) -> Motion:
    motion, reduced = pair
    d_frames = reduced.frames(d_globals[None]).nan_to_num()
    return replace(motion, state=motion.state.retract(d_frames, d_globals[None]))
