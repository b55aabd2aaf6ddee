"""The fit of a batch of hands as least-squares problems for the common descent."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.hands.skeleton import HandSkeleton
from imocap_core.hands.state import CommonHand, HandState, HandViews
from imocap_core.hands.terms import (
    ROTATIONS,
    coupling_cost,
    image_cost,
    prior_cost,
    smooth_cost,
)
from imocap_core.motion.solver.descent import descend
from imocap_core.motion.solver.normal import NormalEquations, solve_globals
from imocap_core.params import HandsParams

TOLERANCE = 1e-4  # a step that lowers the objective by a smaller share is the last
SIZE_RANGE = (0.7, 1.4)
LARGEST_GROWTH = 0.2  # of the logarithm of the size in one step


@dataclass(frozen=True)
class HandProblem:
    """Everything that stays fixed during a fit.

    Attributes:
        skeleton: gives the ranges of motion; fps: (B,) frames a second.
        common: the hand motion that the hands are coupled to, or None.
    """

    views: HandViews
    skeleton: HandSkeleton
    weights: HandsParams
    fps: Float[Tensor, " B"]
    common: CommonHand | None = None

    def cost(self, state: HandState, normal: NormalEquations | None = None) -> Float[Tensor, " B"]:
        """The objective; adds its linearisation to ``normal``."""
        views, weights = self.views, self.weights
        total = image_cost(views, state, weights, normal)
        total = total + prior_cost(views, state, self.skeleton, weights, normal)
        total = total + smooth_cost(views, state, weights, self.fps, normal)
        if self.common is not None:
            total = total + coupling_cost(views, state, self.common, weights, normal)
        return total


def solve_hands(
    problem: HandProblem, state: HandState, max_steps: int
) -> tuple[HandState, Float[Tensor, " B"]]:
    """Hands of known size: the state of lowest objective, and the objective.

    Every hand of the batch is accepted or rejected by itself, so no objective ever rises.
    """
    descent = descend(_EachHand(problem), state, max_steps=max_steps, tolerance=TOLERANCE)
    return descent.state, torch.as_tensor(descent.costs[-1]).to(state.angles)


def solve_hands_and_size(
    problem: HandProblem, state: HandState, max_steps: int, size_spread: float
) -> HandState:
    """Hands and the one size of all of them; size_spread: of its logarithm about 0."""
    together = _OneSize(problem, size_spread)
    return descend(together, state, max_steps=max_steps, tolerance=TOLERANCE).state


def linearise(problem: HandProblem, state: HandState) -> NormalEquations:
    """The normal equations at a state, the size its one global; padded frames get an identity."""
    batch, frames = problem.views.valid.shape
    unknowns = ROTATIONS + 3 * state.offset_m.shape[2]
    normal = NormalEquations.zeros(batch, frames, unknowns, 1, state.angles)
    problem.cost(state, normal)
    padding = (~problem.views.valid)[..., None].to(state.angles)
    torch.diagonal(normal.diagonal, dim1=-2, dim2=-1).add_(padding)
    return normal


@dataclass(frozen=True)
class _EachHand:
    """Hands of known size, a row of the descent each."""

    problem: HandProblem

    def cost(self, state: HandState) -> Float[np.ndarray, " B"]:
        """The objective of each hand."""
        return self.problem.cost(state).cpu().numpy()

    def linearise(self, state: HandState) -> NormalEquations:
        """The normal equations of all hands."""
        return linearise(self.problem, state)

    def trial(
        self, state: HandState, equations: NormalEquations, damping: Float[np.ndarray, " B"]
    ) -> HandState:
        """The hands after the damped step of their frames, the size held."""
        factor = torch.as_tensor(damping).to(state.angles)[:, None, None]
        if equations.diagonal.shape[1] == 1:  # single frames: all in one product
            damped = equations.diagonal.clone()
            diagonal = torch.diagonal(damped, dim1=-2, dim2=-1)
            diagonal.add_(factor * diagonal)
            return state.retract(-torch.linalg.solve(damped, equations.gradient))
        held = equations.gradient.new_zeros(len(damping), 1)
        return state.retract(equations.reduce(factor).frames(held).nan_to_num())

    def choose(
        self, better: Bool[np.ndarray, " B"], trial: HandState, state: HandState
    ) -> HandState:
        """The hands that came down, the others as they were."""
        return trial.where(torch.as_tensor(better, device=state.angles.device), state)


@dataclass(frozen=True)
class _OneSize:
    """All hands and their common size, as the one row of a descent."""

    problem: HandProblem
    size_spread: float

    def cost(self, state: HandState) -> Float[np.ndarray, "1"]:
        """Sum of the hands' objectives and what the size costs."""
        of_size = (math.log(state.size) / self.size_spread) ** 2
        return np.array([float(self.problem.cost(state).sum()) + of_size])

    def linearise(self, state: HandState) -> NormalEquations:
        """The normal equations of all hands, the size's prior among them."""
        normal = linearise(self.problem, state)
        normal.corner[0] += 1 / self.size_spread**2
        normal.corner_gradient[0] += math.log(state.size) / self.size_spread**2
        return normal

    def trial(
        self, state: HandState, equations: NormalEquations, damping: Float[np.ndarray, "1"]
    ) -> HandState:
        """All hands and the size after the damped step."""
        factor = float(damping[0])
        reduced = equations.reduce(factor)
        growth = solve_globals([reduced], factor)
        step = reduced.frames(growth.expand(len(self.problem.fps), 1)).nan_to_num()
        log_factor = float(growth.clamp(-LARGEST_GROWTH, LARGEST_GROWTH))
        size = min(max(state.size * math.exp(log_factor), SIZE_RANGE[0]), SIZE_RANGE[1])
        return replace(state.retract(step), size=size)

    def choose(
        self, better: Bool[np.ndarray, "1"], trial: HandState, state: HandState
    ) -> HandState:
        """All hands are accepted or rejected together."""
        return trial if better[0] else state
