"""What a cycle-consistency method says of its own run."""

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
