"""The interface of a term of the objective, and what terms share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.state import MotionState


@runtime_checkable
class Term(Protocol):
    """A sum of (robust) squared residuals of a state.

    The objective is the sum of all costs; the normal equations are half of its gradient and the
    Gauss-Newton approximation of half of its Hessian.
    """

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion of the batch."""

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Add ``J^T W J`` and ``J^T W r`` of this term at ``state``."""

    def of(self, v: int, frames: int) -> Term:
        """The term of motion ``v`` alone (batch of 1), for its first frames."""


_T = TypeVar("_T")


class OneForAll:
    """A term that is the same for every motion."""

    def of(self: _T, v: int, frames: int) -> _T:
        """Itself."""
        return self


@dataclass(frozen=True)
class Tempered:
    """``share`` of a term: evidence whose errors persist over n frames counts 1/n per frame.

    Its robust weights are those of the full term, because whether a detection is an outlier does
    not depend on its neighbours.
    """

    term: Term
    share: float

    def of(self, v: int, frames: int) -> Tempered:
        """The same share of one motion's term."""
        return replace(self, term=self.term.of(v, frames))

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        return self.share * self.term.cost(state)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Everything that the term adds, times ``share``, without a second system in memory."""
        normal.times(1 / self.share)
        self.term.add_to(normal, state)
        normal.times(self.share)


PIECE = 256  # frames whose derivatives are held at once: 0.1 GB


def pieces(frames: int) -> Iterator[slice]:
    """The frames of a motion, `PIECE` at a time."""
    for first in range(0, frames, PIECE):
        yield slice(first, min(first + PIECE, frames))


def pairs(valid: Bool[Tensor, "B T"]) -> Bool[Tensor, "B steps"]:
    """Which pairs of neighbouring frames exist (T - 1)."""
    return valid[:, :-1] & valid[:, 1:]


def triples(valid: Bool[Tensor, "B T"]) -> Bool[Tensor, "B bends"]:
    """Which three frames in a row exist (T - 2)."""
    return valid[:, :-2] & valid[:, 1:-1] & valid[:, 2:]


def padded(x: Float[Tensor, "B N *rest"], before: int, after: int) -> Float[Tensor, "B T *rest"]:
    """Values with ``before`` and ``after`` zeros around them in time."""
    return torch.nn.functional.pad(x, [0] * (2 * (x.ndim - 2)) + [before, after])


def isotropic(weight: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3 3"]:
    """Metrics that weigh all directions alike."""
    return weight[..., None, None] * torch.eye(3, dtype=weight.dtype, device=weight.device)


def running_mean(values: Float[Tensor, "B C T"], half: int) -> Float[Tensor, "B C T"]:
    """Centred means of 2 half + 1 frames, the first and last frame repeated beyond the ends."""
    padded = torch.nn.functional.pad(values, (half, half), mode="replicate")
    return padded.unfold(-1, 2 * half + 1, 1).mean(-1)
