"""Adam, the gradient descent that the paper names, for comparison with Gauss-Newton."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from imocap_core.motion.gauss_newton import Solution, objective
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms.base import Term

FIRST, SECOND, TINY = 0.9, 0.999, 1e-8


def adam(
    terms: Sequence[Term],
    state: MotionState,
    *,
    max_steps: int,
    learning_rate: float = 0.01,
    shared_globals: bool = False,
) -> Solution:
    """Adam (Kingma & Ba, 2015) on local increments; the best of all states is returned.

    The increments start again from the current state at every step, so rotations stay on their
    manifold; the moments are in the axes of each joint.

    Args:
        terms: the objective; state: the start.
        max_steps: steps, each with one gradient.
        learning_rate: of the increments, radians and metres.
        shared_globals: one body for the batch.
    """
    batch, frames = state.valid.shape
    trans = state.trans
    sizes = ((batch, frames, FRAME_UNKNOWNS), (batch, state.unknown_globals))
    first = [trans.new_zeros(size) for size in sizes]
    second = [trans.new_zeros(size) for size in sizes]
    best, best_cost, costs = state, float("inf"), []
    for step in range(1, max_steps + 2):
        zero = [trans.new_zeros(size).requires_grad_() for size in sizes]
        cost = objective(terms, state.retract(*zero)).sum()
        costs.append(float(cost.detach()))
        if costs[-1] < best_cost:
            best, best_cost = state, costs[-1]
        if step > max_steps:
            break
        gradients = list(torch.autograd.grad(cost, zero, allow_unused=True, materialize_grads=True))
        if shared_globals:
            gradients[1] = gradients[1].sum(0, keepdim=True).expand_as(gradients[1])
        moves = []
        for k, gradient in enumerate(gradients):
            first[k] = FIRST * first[k] + (1 - FIRST) * gradient
            second[k] = SECOND * second[k] + (1 - SECOND) * gradient.square()
            mean = first[k] / (1 - FIRST**step)
            spread = (second[k] / (1 - SECOND**step)).sqrt()
            moves.append(-learning_rate * mean / (spread + TINY))
        state = state.retract(*moves)
    status = f"Adam stopped after {max_steps} steps at its lowest objective"
    done = torch.zeros(batch, dtype=torch.bool, device=trans.device)
    return Solution(best, costs, done, status)
