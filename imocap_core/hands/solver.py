"""Damped Gauss-Newton for a batch of hands, each accepted or rejected by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from imocap_core.hands.problem import CommonHand, HandState, HandViews
from imocap_core.hands.skeleton import HandSkeleton
from imocap_core.hands.terms import (
    ROTATIONS,
    coupling_cost,
    image_cost,
    prior_cost,
    smooth_cost,
)
from imocap_core.motion.solver.normal import NormalEquations, solve_globals
from imocap_core.params import HandsParams

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-7, 1e6
TOLERANCE = 1e-4  # a step that lowers the objective by a smaller share is the last
SIZE_RANGE = (0.7, 1.4)


@dataclass(frozen=True)
class HandProblem:
    """Everything that stays fixed: views, skeleton (ranges), weights, fps (B,), common motion."""

    views: HandViews
    skeleton: HandSkeleton
    weights: HandsParams
    fps: Tensor
    common: CommonHand | None = None

    def cost(self, state: HandState, normal: NormalEquations | None = None) -> Tensor:
        """(B,) the objective; adds its linearisation to `normal`."""
        views, weights = self.views, self.weights
        total = image_cost(views, state, weights, normal)
        total = total + prior_cost(views, state, self.skeleton, weights, normal)
        total = total + smooth_cost(views, state, weights, self.fps, normal)
        if self.common is not None:
            total = total + coupling_cost(views, state, self.common, weights, normal)
        return total


def solve_hands(problem: HandProblem, state: HandState, max_steps: int) -> tuple[HandState, Tensor]:
    """Hands of known size: the state of lowest objective that was found, and the objective (B,).

    Every hand of the batch is accepted or rejected by itself, so no objective ever rises.
    """
    cost = problem.cost(state)
    damping = torch.full_like(cost, FIRST_DAMPING)
    for _ in range(max_steps):
        normal = linearise(problem, state)
        trial = state.retract(_step_of_frames(normal, damping))
        trial_cost = problem.cost(trial)
        better = trial_cost < cost  # NaN is never better
        settled = torch.where(better, cost - trial_cost <= TOLERANCE * cost, damping >= 1.0)
        state, cost = trial.where(better, state), torch.where(better, trial_cost, cost)
        damping = torch.where(better, damping / 5, damping * 10).clamp(LEAST_DAMPING, MOST_DAMPING)
        if settled.all():
            break
    return state, cost


def solve_hands_and_size(
    problem: HandProblem, state: HandState, max_steps: int, size_spread: float
) -> HandState:
    """Hands and the one size of all of them; size_spread: of its logarithm about 0."""

    def total(at: HandState) -> float:
        return float(problem.cost(at).sum()) + (math.log(at.size) / size_spread) ** 2

    cost, damping = total(state), FIRST_DAMPING
    for _ in range(max_steps):
        normal = linearise(problem, state)
        normal.corner[0] += 1 / size_spread**2
        normal.corner_gradient[0] += math.log(state.size) / size_spread**2
        while damping <= MOST_DAMPING:
            reduced = normal.reduce(damping)
            grown = solve_globals([reduced], damping)
            step = reduced.frames(grown.expand(len(problem.fps), 1)).nan_to_num()
            size = state.size * math.exp(min(max(float(grown), -0.2), 0.2))
            size = min(max(size, SIZE_RANGE[0]), SIZE_RANGE[1])
            trial = replace(state.retract(step), size=size)
            trial_cost = total(trial)
            if trial_cost < cost:
                break
            damping *= 8
        else:
            break
        settled = cost - trial_cost <= TOLERANCE * cost
        state, cost, damping = trial, trial_cost, max(damping / 5, LEAST_DAMPING)
        if settled:
            break
    return state


def linearise(problem: HandProblem, state: HandState) -> NormalEquations:
    """The normal equations at a state, the size its one global; padded frames get an identity."""
    batch, frames = problem.views.valid.shape
    unknowns = ROTATIONS + 3 * state.offset_m.shape[2]
    normal = NormalEquations.zeros(batch, frames, unknowns, 1, state.angles)
    problem.cost(state, normal)
    padding = (~problem.views.valid)[..., None].to(state.angles)
    torch.diagonal(normal.diagonal, dim1=-2, dim2=-1).add_(padding)
    return normal


def _step_of_frames(normal: NormalEquations, damping: Tensor) -> Tensor:
    """(B, T, n) increments with the size held; damping (B,) by Marquardt's scaling."""
    diagonal = torch.diagonal(normal.diagonal, dim1=-2, dim2=-1)
    diagonal.add_(damping[:, None, None] * diagonal)
    if normal.diagonal.shape[1] == 1:
        return -torch.linalg.solve(normal.diagonal, normal.gradient)
    held = normal.gradient.new_zeros(len(damping), 1)
    return normal.reduce(0.0).frames(held).nan_to_num()
