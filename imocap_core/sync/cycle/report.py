"""What a cycle-consistency method says of its own run."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class CycleReport:
    """`change` holds one number per iteration: the relative change (softmap) or the larger ADMM
    residual (als, svt)."""

    method: str
    converged: bool
    change: tuple[float, ...]
    status: str

    @property
    def iterations(self) -> int:
        """How many iterations were run."""
        return len(self.change)


def outcome_of(residuals: Sequence[float], tolerance: float) -> str:
    """Whether the last residual is below the tolerance, after how many iterations, for people."""
    after = f"after {len(residuals)} iterations"
    if residuals[-1] < tolerance:
        return f"converged {after}"
    return f"not converged {after} (residual {residuals[-1]:.2g}, {tolerance:.2g} was asked)"
