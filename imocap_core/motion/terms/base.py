"""The interface of a term of the objective."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState


@runtime_checkable
class Term(Protocol):
    """A sum of (robust) squared residuals of a state.

    The objective is the sum of all costs; the normal equations are half of its gradient and the
    Gauss-Newton approximation of half of its Hessian.
    """

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion of the batch."""
        ...

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Add ``J^T W J`` and ``J^T W r`` of this term at ``state``."""
        ...

    def of(self, v: int, frames: int) -> Term:
        """The term of motion ``v`` alone (batch of 1), for its first frames."""
        ...
