"""Outcome of a cycle-consistency method: iterations, convergence, one sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class CycleReport:
    """Outcome of a cycle-consistency method.

    Attributes:
        method: softmap, als, svt or none.
        converged: the last residual is below the tolerance.
        change: one number per iteration: the relative change (softmap) or the larger ADMM residual
            (als, svt).
        status: one sentence.
    """

    method: str
    converged: bool
    change: tuple[float, ...]
    status: str


def convergence_report(
    method: str, residuals: Sequence[float], tolerance: float, detail: str = ""
) -> CycleReport:
    """Outcome of an iteration that stops when the residual is below the tolerance; the status ends
    with `detail`."""
    converged = residuals[-1] < tolerance
    after = f"after {len(residuals)} iterations"
    status = (
        f"converged {after}"
        if converged
        else f"not converged {after} (residual {residuals[-1]:.2g}, {tolerance:.2g} was asked)"
    )
    return CycleReport(method, converged, tuple(residuals), f"{method}: {status}{detail}")
