"""A term with a fraction of its weight."""

from __future__ import annotations

from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms.base import Term


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
