"""What every term of the objective offers to the solver."""

from typing import Protocol, Self

from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState


class Term(Protocol):
    """A sum of (robust) squared residuals of a state.

    The objective is the sum of all costs; the normal equations hold half of its gradient and
    the Gauss-Newton approximation of half of its Hessian.
    """

    def cost(self, state: MotionState) -> Tensor:
        """(B,) cost of each motion of the batch."""
        ...

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Add ``J^T W J`` and ``J^T W r`` of this term at ``state``."""
        ...

    def of(self, v: int, frames: int) -> Self:
        """The term of motion ``v`` alone (batch of 1), for its first frames."""
        ...
