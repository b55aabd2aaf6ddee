"""Damped Gauss-Newton with guaranteed descent. It knows residuals, not bodies."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms.base import Term

FIRST_DAMPING = 1e-3
LARGEST_DAMPING = 1e6


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


def objective(terms: Sequence[Term], state: MotionState) -> Tensor:
    """(B,) sum of all terms."""
    return torch.stack([term.cost(state) for term in terms]).sum(0)


def linearise(terms: Sequence[Term], state: MotionState) -> NormalEquations:
    """The normal equations of all terms at ``state``; padded frames get the identity."""
    batch, frames = state.valid.shape
    normal = NormalEquations.zeros(
        batch, frames, FRAME_UNKNOWNS, state.unknown_globals, state.trans
    )
    for term in terms:
        term.add_to(normal, state)
    torch.diagonal(normal.diagonal, dim1=-2, dim2=-1).add_(
        (~state.valid)[..., None].to(state.trans)
    )
    return normal


def gauss_newton(
    terms: Sequence[Term],
    state: MotionState,
    *,
    max_steps: int,
    relative_tolerance: float = 1e-4,
    shared_globals: bool = False,
    free_shape: bool = True,
) -> Solution:
    """Levenberg-Marquardt on the block-banded system, one damping factor per motion.

    A step that raises a motion's objective is rejected and its damping grows, so the objective
    never rises. With ``shared_globals`` the batch is one body: it is accepted or rejected together
    and must start with equal betas.

    Args:
        terms: the objective; state: the start.
        max_steps: linearisations at most.
        relative_tolerance: a motion has converged when an accepted step lowers its objective by
            less than this share.
        shared_globals: one body for the batch; free_shape: False holds the betas.
    """
    cost = objective(terms, state)
    damping = torch.full_like(cost, FIRST_DAMPING)
    converged = torch.zeros_like(cost, dtype=torch.bool)
    costs = [float(cost.sum())]
    for _ in range(max_steps):
        normal = linearise(terms, state)
        if not free_shape:
            shape = slice(0, state.betas.shape[1])
            normal.border[..., shape] = 0.0
            normal.corner[:, shape] = normal.corner[:, :, shape] = 0.0
            normal.corner_gradient[:, shape] = 0.0
        tried = False
        while not tried:
            d_frames, d_globals = normal.solve(damping, shared=shared_globals)
            trial = state.retract(d_frames.nan_to_num(), d_globals.nan_to_num())
            trial_cost = objective(terms, trial)
            better = _accept(trial_cost, cost, shared_globals) & ~converged
            drop = (cost - trial_cost).sum() if shared_globals else cost - trial_cost
            scale = cost.sum() if shared_globals else cost
            settled = better & (drop <= relative_tolerance * scale)
            state = state.choose(trial, better)
            cost = torch.where(better, trial_cost, cost)
            damping = torch.where(better, damping / 5, damping * 8).clamp(1e-9, 1e9)
            stuck = damping > LARGEST_DAMPING
            converged = converged | settled | stuck
            tried = bool((better | converged).any())
        costs.append(float(cost.sum()))
        if bool(converged.all()):
            break
    done = bool(converged.all())
    status = (
        f"converged after {len(costs) - 1} steps"
        if done
        else f"stopped after {max_steps} steps before every motion settled"
    )
    return Solution(state, costs, converged, status)


def _accept(trial: Tensor, cost: Tensor, together: bool) -> Tensor:
    """(B,) bool: which motions take the step; NaN is never better."""
    if together:
        return (trial.sum() < cost.sum()).expand_as(cost)
    return trial < cost
