"""The sum of all terms of an objective, and its normal equations."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms.base import Term
from imocap_core.workers import Each

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


def linearise_halves(terms: Sequence[Term], state: MotionState, each: Each) -> NormalEquations:
    """`linearise`, every second term by itself."""
    halves = [terms[k::HALVES] for k in range(min(HALVES, len(terms)))]
    first, *others = each(lambda half: _of_terms(half, state), halves)
    normal: NormalEquations = first
    for other in others:
        normal = normal.plus(other)
    return _with_padding(normal, state)
